"""The check of gradients."""

import pytest
import torch

from gsfw.kernels.cuda.step_jobs import FINITE_NUMBERS, FINITE_TENSORS

DTYPES = [torch.float32, torch.float64]


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("count", [1, 15, 16, 17, 64, 257, FINITE_NUMBERS, 70_000])
def test_one_bad_number_anywhere_is_found(operators, count, dtype, use_threads):
    use_threads(2)
    numbers = torch.randn(count, dtype=dtype)
    assert operators.all_finite([numbers])
    for place in {*range(0, count, max(count // 8, 1)), count - 1}:
        for bad in (float("nan"), float("inf"), -float("inf")):
            broken = numbers.clone()
            broken[place] = bad
            assert not operators.all_finite([numbers, broken])


@pytest.mark.parametrize("dtype", DTYPES)
def test_numbers_at_the_edge_of_the_type_are_finite(operators, dtype):
    limits = torch.finfo(dtype)
    extremes = [limits.max, limits.min, limits.tiny, limits.tiny * limits.eps, 0.0, -0.0]
    assert operators.all_finite([torch.tensor(extremes, dtype=dtype).repeat(30)])


def test_every_tensor_of_a_long_list_is_checked(operators):
    numbers = [torch.ones(1 + index % 5) for index in range(2 * FINITE_TENSORS + 1)]
    assert operators.all_finite(numbers)
    for index in (0, 1, FINITE_TENSORS - 1, FINITE_TENSORS, 2 * FINITE_TENSORS):
        broken = [*numbers]
        broken[index] = torch.full_like(numbers[index], torch.nan)
        assert not operators.all_finite(broken)


def test_memory_that_begins_anywhere_is_checked(operators):
    numbers = torch.ones(FINITE_NUMBERS + 2)
    numbers[0] = torch.nan
    assert operators.all_finite([numbers[1:]])
    numbers[-1] = torch.inf
    assert not operators.all_finite([numbers[1:]])


def test_tensors_of_every_kind_are_checked(operators):
    parameter = torch.nn.Parameter(torch.ones(3, 4))
    finite = [torch.tensor(1.0), torch.zeros(0), parameter, parameter[:, ::2], torch.ones(2).half()]
    finite.append(torch.ones(3, dtype=torch.float64))
    found = operators.all_finite(finite)
    assert (found.dtype, found.shape) == (torch.bool, ())
    assert found
    half, double = torch.full((2,), torch.nan).half(), torch.full((2,), torch.nan).double()
    for bad in (torch.full((3, 4), torch.inf)[:, ::2], half, double):
        assert not operators.all_finite([*finite, bad])


def test_nothing_but_what_kernels_do_not_take_goes_to_torch(operators):
    assert operators.all_finite([torch.ones(2).half(), torch.ones(3).bfloat16()])
