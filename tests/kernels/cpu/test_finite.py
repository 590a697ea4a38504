"""The check of gradients."""

import pytest
import torch

from gsfw.kernels.cpu.operators import CpuOperators

pytestmark = pytest.mark.usefixtures("instruction_set")

DTYPES = [torch.float32, torch.float64]


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("count", [1, 15, 16, 17, 63, 64, 65, 1000, 70_000])
def test_one_bad_number_anywhere_is_found(count, dtype, use_threads):
    use_threads(2)
    numbers = torch.randn(count, dtype=dtype)
    assert CpuOperators().all_finite([numbers])
    for place in {*range(0, count, max(count // 64, 1)), count - 1}:
        for bad in (float("nan"), float("inf"), -float("inf")):
            broken = numbers.clone()
            broken[place] = bad
            assert not CpuOperators().all_finite([numbers, broken])


@pytest.mark.parametrize("dtype", DTYPES)
def test_numbers_at_the_edge_of_the_type_are_finite(dtype):
    limits = torch.finfo(dtype)
    extremes = [limits.max, limits.min, limits.tiny, limits.tiny * limits.eps, 0.0, -0.0]
    assert CpuOperators().all_finite([torch.tensor(extremes, dtype=dtype).repeat(30)])


def test_tensors_of_every_kind_are_checked():
    parameter = torch.nn.Parameter(torch.ones(3, 4))
    finite = [torch.tensor(1.0), torch.zeros(0), parameter, parameter[:, ::2], torch.ones(2).half()]
    found = CpuOperators().all_finite(finite)
    assert (found.dtype, found.shape) == (torch.bool, ())
    assert found
    for bad in (torch.full((3, 4), torch.inf)[:, ::2], torch.full((2,), torch.nan).half()):
        assert not CpuOperators().all_finite([*finite, bad])
