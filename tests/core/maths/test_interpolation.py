"""Interpolation in grids, against torch's grid_sample."""

from itertools import product

import pytest
import torch
from torch.nn.functional import grid_sample

from gsfw.core.maths.interpolation import WIDE, interpolate, weighted_rows


def uniform(*shape: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return 2 * torch.rand(*shape, generator=generator, dtype=torch.float64) - 1


def sampled(grids, coordinates):
    """The same by grid_sample, which takes channels first and the last axis first."""
    places = coordinates.movedim(0, -1).flip(-1)
    places = places[(slice(None), *[None] * (len(coordinates) - 1))]
    values = grid_sample(
        grids.movedim(-1, 1), places, mode="bilinear", padding_mode="border", align_corners=True
    )
    return values.flatten(2).transpose(1, 2)


@pytest.mark.parametrize("channels", [3, WIDE, 32])
@pytest.mark.parametrize("cells", [(6, 9), (2, 2), (4, 5, 3)])
def test_values_and_gradients_are_those_of_grid_sample(cells, channels):
    grids = uniform(3, *cells, channels).requires_grad_()
    coordinates = uniform(len(cells), 3, 40, seed=1).requires_grad_()
    gradient = uniform(3, 40, channels, seed=2)
    found, expected = interpolate(grids, coordinates), sampled(grids, coordinates)
    torch.testing.assert_close(found, expected, atol=1e-13, rtol=0)
    mine = torch.autograd.grad(found, [grids, coordinates], gradient)
    theirs = torch.autograd.grad(expected, [grids, coordinates], gradient)
    for one, other in zip(mine, theirs, strict=True):
        torch.testing.assert_close(one, other, atol=1e-12, rtol=0)


def test_one_axis_is_a_line_between_neighbours():
    line = torch.tensor([[[0.0], [10.0], [40.0]]])
    places = torch.tensor([[[-1.0, -0.5, 0.0, 0.5, 1.0]]])
    assert interpolate(line, places).flatten().tolist() == [0, 5, 10, 25, 40]


def test_beyond_the_ends_it_is_constant():
    line, places = torch.tensor([[[1.0], [3.0]]]), torch.tensor([[[-7.0, 9.0]]], requires_grad=True)
    values = interpolate(line, places)
    assert values.flatten().tolist() == [1, 3]
    values.sum().backward()
    assert places.grad is not None
    assert not places.grad.any()


def test_a_place_that_is_no_number_has_such_a_value_and_others_are_as_before():
    grids, coordinates = uniform(2, 4, 5, WIDE), uniform(2, 2, 6, seed=1)
    expected = interpolate(grids, coordinates)
    coordinates[0, 1, 3] = torch.nan
    found = interpolate(grids, coordinates)
    assert found[1, 3].isnan().all()
    found[1, 3] = expected[1, 3]
    assert torch.equal(found, expected)


def test_no_place_at_all_is_no_value():
    grids = uniform(2, 4, 4, 8).requires_grad_()
    values = interpolate(grids, torch.zeros(2, 2, 0, dtype=torch.float64))
    assert values.shape == (2, 0, 8)
    values.sum().backward()
    assert grids.grad is not None
    assert not grids.grad.any()


@pytest.mark.parametrize("channels", [2, 16])
def test_weighted_rows_are_sums_of_rows(channels):
    table = uniform(7, channels).requires_grad_()
    rows = torch.tensor([[0, 3, 3], [6, 1, 0]], dtype=torch.int32)
    weights = uniform(2, 3, seed=1)
    expected = (table[rows.long()] * weights[:, :, None]).sum(1)
    found = weighted_rows(table, rows, weights)
    torch.testing.assert_close(found, expected)
    gradient = uniform(2, channels, seed=2)
    (mine,) = torch.autograd.grad(found, table, gradient)
    (theirs,) = torch.autograd.grad(expected, table, gradient)
    torch.testing.assert_close(mine, theirs)


@pytest.mark.parametrize("channels", [4, 32])
def test_deterministic_algorithms_allow_it_and_repeat_it(channels):
    before = torch.get_deterministic_debug_mode()
    torch.set_deterministic_debug_mode("error")
    try:
        grids = uniform(3, 8, 8, channels).float().requires_grad_()
        places = uniform(2, 3, 5000, seed=1).float().requires_grad_()
        first, again = (
            torch.autograd.grad(interpolate(grids, places).square().sum(), [grids, places])
            for _ in range(2)
        )
    finally:
        torch.set_deterministic_debug_mode(before)
    for one, other in zip(first, again, strict=True):
        assert torch.equal(one, other)


def test_corners_are_met_exactly():
    grids = uniform(1, 3, 4, 8)
    for row, column in product(range(3), range(4)):
        places = torch.tensor([row - 1.0, column / 1.5 - 1.0], dtype=torch.float64)
        value = interpolate(grids, places.view(2, 1, 1))[0, 0]
        torch.testing.assert_close(value, grids[0, row, column])
