"""Nearest points, on the emulation."""

import pytest
import torch
from support.calls import CountedLauncher

from gsfw.core.operators import Operators
from gsfw.kernels.cuda import neighbors
from gsfw.kernels.cuda.neighbors import can_find
from gsfw.kernels.cuda.operators import CudaOperators
from gsfw.kernels.cuda.step_jobs import NEIGHBOR_THREADS

SIZES = (30, NEIGHBOR_THREADS, NEIGHBOR_THREADS + 45)


def points(count: int, axes: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.randn(count, axes, generator=torch.Generator().manual_seed(count)).to(dtype)


@pytest.mark.parametrize("count", SIZES)
@pytest.mark.parametrize(("axes", "k"), [(3, 20), (4, 8), (3, 1), (4, 29)])
def test_the_nearest_points_come_in_order(operators, count, axes, k):
    given = points(count, axes)
    assert can_find(given, k)
    distances = torch.cdist(given, given).fill_diagonal_(torch.inf)
    found = operators.neighbors(given, k)
    assert found.dtype == torch.int64
    assert torch.equal(found, distances.argsort(dim=1)[:, :k])
    assert torch.equal(found, Operators().neighbors(given, k))


@pytest.mark.parametrize("seed", [0, 1])
def test_single_precision_finds_the_same_whatever_the_order_of_threads(operators_of, seed):
    given = points(SIZES[-1], 4, torch.float32)
    found = operators_of(seed).neighbors(given, 8)
    distances = (given[:, None] - given).square().sum(2)
    expected = distances.fill_diagonal_(torch.inf).sort(1).values[:, :8]
    torch.testing.assert_close(distances.gather(1, found), expected)


def test_rows_that_are_found_in_several_launches_are_those_of_one(monkeypatch):
    given, launcher = points(SIZES[-1], 3), CountedLauncher()
    expected = CudaOperators(launcher).neighbors(given, 20)
    monkeypatch.setitem(neighbors.MOST_PAIRS, given.dtype, NEIGHBOR_THREADS * len(given))
    found = CudaOperators(launcher).neighbors(given, 20)
    assert len(launcher.launches) == 1 + 2
    assert torch.equal(found, expected)


def test_fewer_points_than_neighbors_are_filled_up_with_the_own_row(operators):
    assert operators.neighbors(torch.zeros(1, 3), 3).tolist() == [[0, 0, 0]]
    assert operators.neighbors(torch.eye(4)[:2], 3).tolist() == [[1, 0, 0], [0, 1, 1]]


def test_of_points_at_one_place_none_is_its_own_neighbor(operators):
    rows = operators.neighbors(torch.zeros(6, 4), 3)
    own = torch.arange(6)[:, None]
    assert not bool((rows == own).any())
    assert all(len(set(row)) == 3 for row in rows.tolist())


def test_points_that_the_kernel_does_not_take_are_left_to_the_host(operators):
    for count, axes, k in ((30, 2, 4), (40, 3, 33), (0, 3, 1)):
        given = points(count, axes)
        assert not can_find(given, k)
        assert torch.equal(operators.neighbors(given, k), Operators().neighbors(given, k))
