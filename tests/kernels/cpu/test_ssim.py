"""The fused L1 and SSIM of the CPU against plain torch."""

from functools import cache

import pytest
import torch
from support.losses import images, losses_and_gradients, relative_error
from torch import Tensor

from gsfw.core.operators import Operators
from gsfw.kernels.cpu.operators import CpuOperators

pytestmark = pytest.mark.usefixtures("instruction_set")

SHAPES = [
    (2, 40, 50, 3),
    (1, 1, 1, 3),
    (1, 1, 4096, 3),
    (1, 4096, 1, 1),
    (1, 7, 5, 1),
    (1, 3, 30, 4),
    (1, 120, 700, 3),
    (2, 12, 9, 17),
]


@cache
def of_torch(shape: tuple[int, ...], dtype: torch.dtype, masked: bool) -> list[Tensor]:
    """Losses and gradients of plain torch in float64, the same for every instruction set."""
    rendered, target, valid = images(shape, dtype)
    exact = rendered.detach().double().requires_grad_()
    mask = valid if masked else None
    return losses_and_gradients(Operators(), exact, target.double(), mask)


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-12), (torch.float32, 1e-5)])
def test_values_and_gradients_agree_with_torch(shape, dtype, tolerance, masked):
    rendered, target, valid = images(shape, dtype)
    found = losses_and_gradients(CpuOperators(), rendered, target, valid if masked else None)
    expected = of_torch(shape, dtype, masked)
    assert [value.dtype for value in found] == [dtype] * 4
    for value, other in zip(found, expected, strict=True):
        assert relative_error(value, other) < tolerance


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_any_number_of_threads_gives_the_same_bits(dtype, use_threads):
    rendered, target, valid = images((2, 230, 410, 3), dtype)
    results = []
    for threads in (1, 2, 5):
        use_threads(threads)
        results.append(losses_and_gradients(CpuOperators(), rendered, target, valid))
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))
