"""The fused L1 and SSIM of CUDA, emulated, against plain torch."""

import math

import pytest
import torch
from support.losses import images, losses_and_gradients, relative_error

from gsfw.core.maths.ssim import C1, C2, SIGMA, WINDOW
from gsfw.core.operators import Operators
from gsfw.kernels.cuda.source_files import source_text

SHAPES = [
    (2, 40, 50, 3),
    (1, 1, 1, 3),
    (1, 1, 100, 3),
    (1, 100, 1, 1),
    (1, 7, 5, 1),
    (1, 3, 30, 4),
    (3, 17, 33, 2),
    (1, 16, 32, 1),
    (1, 12, 9, 17),
]


@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-12), (torch.float32, 1e-5)])
def test_values_and_gradients_agree_with_torch(operators, shape, dtype, tolerance, masked):
    rendered, target, valid = images(shape, dtype)
    valid[0, 0, 0] = True
    mask = valid if masked else None
    found = losses_and_gradients(operators, rendered, target, mask)
    exact = rendered.detach().double().requires_grad_()
    expected = losses_and_gradients(Operators(), exact, target.double(), mask)
    assert [value.dtype for value in found] == [dtype] * 4
    for value, other in zip(found, expected, strict=True):
        assert relative_error(value, other) < tolerance


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_any_order_of_threads_gives_the_same_bits(operators_of, dtype):
    rendered, target, valid = images((2, 30, 41, 3), dtype)
    results = [
        losses_and_gradients(operators_of(seed), rendered, target, valid) for seed in (0, 1, 2)
    ]
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))


def test_bright_images_that_hardly_differ_keep_their_digits(operators):
    generator = torch.Generator().manual_seed(7)
    target = torch.ones(1, 40, 40, 1)
    rendered = target + 1e-4 * torch.randn(target.shape, generator=generator)
    rendered.requires_grad_()
    found = losses_and_gradients(operators, rendered, target, None)
    exact = rendered.detach().double().requires_grad_()
    expected = losses_and_gradients(Operators(), exact, target.double(), None)
    # Plain torch in float32 has 1 - SSIM 92% off here.
    assert relative_error(found[1], expected[1]) < 1e-4
    assert relative_error(found[2], expected[2]) < 1e-3


def test_the_kernels_know_the_window_and_the_constants():
    text = source_text("ssim.cu")
    weights = [math.exp(-((k - WINDOW // 2) ** 2) / (2 * SIGMA**2)) for k in range(WINDOW)]
    for weight in weights[: WINDOW // 2 + 1]:
        assert repr(weight / sum(weights)) in text
    assert "C1 = 0.01 * 0.01, C2 = 0.03 * 0.03" in text
    assert (C1, C2) == (0.01 * 0.01, 0.03 * 0.03)
