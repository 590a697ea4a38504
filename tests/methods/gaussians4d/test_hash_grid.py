"""The hash grid in place and time, against loops over corners."""

from itertools import product

import pytest
import torch

from gsfw.core.maths.hash_features import PRIMES
from gsfw.core.operators import Operators
from gsfw.methods.gaussians4d.config import HashConfig
from gsfw.methods.gaussians4d.hash_grid import HashGrid

SMALL = HashConfig(levels=3, features=2, log2_rows=8, coarsest=2, finest=8)


def tables(config: HashConfig = SMALL, times: int = 4) -> HashGrid:
    generator = torch.Generator().manual_seed(0)
    grid = HashGrid(config, times, Operators(), generator).double()
    for table in grid.tables:
        torch.nn.init.normal_(table, generator=generator)
    return grid


def places(n: int = 12) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    return 2 * torch.rand(n, 3, generator=generator, dtype=torch.float64) - 1


def looked_up(table, counts, point, time):
    """One level at one place, corner by corner, with Python's integers."""
    scaled = [
        unit * (count - 1)
        for unit, count in zip([*((point + 1) / 2).tolist(), time], counts, strict=True)
    ]
    low = [min(int(value), count - 2) for value, count in zip(scaled, counts, strict=True)]
    dense = counts[0] * counts[1] * counts[2] * counts[3] <= len(table)
    total = torch.zeros(table.shape[1], dtype=torch.float64)
    for steps in product((0, 1), repeat=4):
        weight, row, stride = 1.0, 0, 1
        for axis, step in enumerate(steps):
            inside = scaled[axis] - low[axis]
            weight *= inside if step else 1 - inside
            if dense:
                row += (low[axis] + step) * stride
                stride *= counts[axis]
            else:
                row ^= (low[axis] + step) * PRIMES[axis]
        total += weight * table[row if dense else row % len(table)]
    return total


@pytest.mark.parametrize("time", [0.0, 0.4, 1.0])
def test_features_are_those_of_a_loop_over_corners(time):
    grid, points = tables(), places()
    found = grid(points, torch.tensor(time, dtype=torch.float64))
    counts = [(3, 3, 3, 3), (5, 5, 5, 4), (9, 9, 9, 4)]
    assert [len(table) for table in grid.tables] == [81, 256, 256]
    expected = [
        torch.cat(
            [
                looked_up(table.detach(), sizes, point, time)
                for table, sizes in zip(grid.tables, counts, strict=True)
            ]
        )
        for point in points
    ]
    torch.testing.assert_close(found, torch.stack(expected), atol=1e-12, rtol=1e-12)


def test_places_are_detached_and_rows_have_the_gradients_of_finite_differences():
    grid, time = tables(), torch.tensor(0.3, dtype=torch.float64)
    points = places().requires_grad_()
    grid(points, time).sum().backward()
    assert points.grad is None
    parameters = tuple(grid.parameters())
    assert torch.autograd.gradcheck(lambda *_: grid(points, time), parameters, fast_mode=True)


def test_times_outside_are_those_of_the_ends():
    grid, points = tables(), places()
    for outside, end in ((-2.0, 0.0), (1e8, 1.0)):
        found, expected = (
            grid(points, torch.tensor(time, dtype=torch.float64)) for time in (outside, end)
        )
        assert torch.equal(found, expected)


def test_resolutions_grow_geometrically_and_tables_have_their_limit():
    grid = HashGrid(HashConfig(), 10, Operators(), torch.Generator().manual_seed(0))
    assert [size for size, _ in grid._sizes] == [9, 13, 19, 27, 40, 59, 87, 129]
    assert {times for _, times in grid._sizes} == {9, 10}
    assert max(len(table) for table in grid.tables) == 2**15
    assert grid.features == 32
