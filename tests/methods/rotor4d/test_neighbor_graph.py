"""Neighbours of rows: refreshed in time, and part of the state."""

import torch

from gsfw.core.operators import Operators
from gsfw.methods.rotor4d.neighbor_graph import NeighborGraph


def points(n: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(n, 4, generator=torch.Generator().manual_seed(seed))


def test_neighbors_are_looked_for_at_intervals_and_when_rows_come_or_go():
    graph, operators = NeighborGraph(3, refresh_every=10), Operators()
    graph.refresh_(7, points(20), operators)
    first = graph.rows
    assert torch.equal(first, operators.neighbors(points(20), 3))
    graph.refresh_(8, points(20, seed=1), operators)
    assert torch.equal(graph.rows, first)
    graph.refresh_(10, points(20, seed=1), operators)
    assert not torch.equal(graph.rows, first)
    graph.refresh_(11, points(25), operators)
    assert len(graph.rows) == 25


def test_means_are_over_the_neighbors_of_the_rows_asked_for():
    graph = NeighborGraph(3, refresh_every=1)
    graph.refresh_(0, points(20), Operators())
    values, rows = points(20, seed=2)[:, :3], torch.tensor([4, 17])
    expected = torch.stack([values[graph.rows[row]].mean(0) for row in (4, 17)])
    torch.testing.assert_close(graph.mean(values, rows), expected)


def test_a_restored_graph_has_the_same_neighbors_whatever_it_had_before():
    graph, other = (NeighborGraph(3, refresh_every=10) for _ in range(2))
    graph.refresh_(0, points(20), Operators())
    other.load_state_dict(graph.state_dict())
    assert torch.equal(other.rows, graph.rows)
