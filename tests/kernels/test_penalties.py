"""Regularisers of grids in kernels against plain torch in float64."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.calls import Calls, CountedLauncher
from support.field_tensors import agree, distance, gradients, numbers, variation

from gsfw.core.operators import Operators
from gsfw.kernels.cuda.field_jobs import GRID_NUMBERS
from gsfw.kernels.cuda.operators import CudaOperators

DTYPES = [torch.float32, torch.float64]

VARIATIONS = [
    ((3, 7, 9, 32), (1, 2), 1), ((25, 3, 6, 32), (0,), 2), ((25, 3, 6, 5), (0,), 1),
    ((2, 3, 6, 5), (0,), 2), ((4, 5, 6), (2,), 2), ((1, 4, 4, 3), (0, 1), 1),
    ((4, 5, 6), (-2, -1), 1), ((1,), (0,), 1), ((3,), (0,), 2), ((1, 1, 4), (0, 1), 1),
    ((3, 37, 41, 3), (1, 2), 1),
]  # fmt: skip


@pytest.mark.parametrize(("shape", "axes", "order"), VARIATIONS)
@pytest.mark.parametrize("dtype", DTYPES)
def test_squared_differences_and_their_gradient_are_those_of_torch(
    operators_there, place, shape, axes, order, dtype
):
    agree(variation(axes, order), operators_there, [numbers(*shape, seed=3, dtype=dtype)], place)


@pytest.mark.parametrize("count", [1, 31, GRID_NUMBERS, 3 * GRID_NUMBERS + 1])
@pytest.mark.parametrize("dtype", DTYPES)
def test_distances_and_their_gradient_are_those_of_torch(operators_there, place, count, dtype):
    values = numbers(count, seed=3, dtype=dtype)
    values[0] = 0.5
    agree(distance, operators_there, [values], place)


@settings(max_examples=25)
@given(st.lists(st.integers(1, 6), min_size=4, max_size=4), st.integers(0, 3), st.data())
def test_any_axes_of_any_grid_agree_with_torch(operators_there, place, shape, axis, data):
    order = data.draw(st.integers(1, 2))
    pair = order == 1 and axis < 3 and data.draw(st.booleans())
    axes = (axis, axis + 1) if pair else (axis,)
    agree(variation(axes, order), operators_there, [numbers(*shape, seed=sum(shape))], place)


def test_sums_over_many_small_numbers_keep_their_digits(operators_there, place):
    """A sum of a million numbers in float32, one after another, would lose three of them."""
    grid = 1.0 + 1e-3 * numbers(500_000, seed=1, dtype=torch.float32)
    found = operators_there.mean_distance(grid.to(place), 0.0, 1.0).cpu()
    assert abs(float(found) / float(grid.double().mean()) - 1) < 1e-7


@pytest.mark.parametrize("dtype", DTYPES)
def test_any_order_of_threads_gives_the_same_bits(operators_of, dtype):
    grid = [numbers(3, 30, 31, 5, seed=1, dtype=dtype)]
    for function in (variation((1, 2), 1), variation((1,), 2), distance):
        first, *others = (
            gradients(function, operators_of(seed), grid, torch.device("cpu")) for seed in (0, 1, 2)
        )
        for other in others:
            assert all(torch.equal(one, two) for one, two in zip(first, other, strict=True))


def test_a_number_that_is_none_shows(operators_there, place):
    grid = numbers(4, 5, 6, seed=1)
    grid[1, 2, 3] = math.nan
    for function in (variation((1, 2), 1), variation((0,), 2), distance):
        assert function(operators_there, [grid.to(place)])[0].isnan()


def test_grids_that_are_not_contiguous_are_taken_too(operators_there, place):
    grid = numbers(6, 5, 4, seed=1).permute(2, 0, 1)
    for function in (variation((0, 1), 1), distance):
        agree(function, operators_there, [grid], place)


def test_a_value_takes_two_launches_and_its_gradient_one():
    launcher = CountedLauncher()
    grid = numbers(4, 5, 6, seed=1).requires_grad_()
    for function, name in ((variation((1,), 1), "grid_variation"), (distance, "grid_distance")):
        with Calls(launcher) as calls:
            function(CudaOperators(launcher), [grid])[0].backward()
        names = [expression.partition("<")[0] for expression in calls.launches]
        assert names == [name, "add_penalty", f"{name}_backward"]


LEFT = {
    "no numbers": (torch.zeros(0, 3), (1,), 1),
    "half precision": (numbers(4, 3, seed=1).half(), (1,), 1),
    "axes apart": (numbers(4, 3, 5, seed=1), (0, 2), 1),
    "second differences along two": (numbers(4, 3, 5, seed=1), (0, 1), 2),
}


@pytest.mark.parametrize("case", LEFT)
def test_what_kernels_do_not_take_goes_to_torch(case):
    launcher = CountedLauncher()
    grid, axes, order = LEFT[case]
    found, expected = (
        kind.squared_differences(grid, axes, order, 1.0)
        for kind in (CudaOperators(launcher), Operators())
    )
    assert torch.equal(found.nan_to_num(7.0), expected.nan_to_num(7.0))
    assert launcher.launches == []
