"""Neighbours of rows: refreshed in time, and part of the state."""

import torch

from gsfw.core.operators import Operators
from gsfw.methods.rotor4d.neighbor_graph import NeighborGraph


def points(n: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(n, 4, generator=torch.Generator().manual_seed(seed))


def test_neighbors_are_looked_for_at_intervals_and_when_rows_come_or_go():
    graph, operators = NeighborGraph(3, refresh_every=10), Operators()
    assert graph.is_due(7, 20)
    graph.refresh_(points(20), operators)
    assert torch.equal(graph.rows, operators.neighbors(points(20), 3))
    assert [graph.is_due(step, 20) for step in (8, 9, 10, 11, 20)] == [
        False,
        False,
        True,
        False,
        True,
    ]
    assert graph.is_due(8, 25)


def test_neighbors_of_as_many_rows_are_where_they_were():
    graph, operators = NeighborGraph(3, refresh_every=10), Operators()
    graph.refresh_(points(20), operators)
    place = graph.rows.data_ptr()
    graph.refresh_(points(20, seed=1), operators)
    assert graph.rows.data_ptr() == place
    assert torch.equal(graph.rows, operators.neighbors(points(20, seed=1), 3))
    graph.refresh_(points(25), operators)
    assert len(graph.rows) == 25


def test_means_are_over_the_neighbors_of_the_rows_asked_for():
    graph = NeighborGraph(3, refresh_every=1)
    graph.refresh_(points(20), Operators())
    values, rows = points(20, seed=2)[:, :3], torch.tensor([4, 17])
    expected = torch.stack([values[graph.rows[row]].mean(0) for row in (4, 17)])
    torch.testing.assert_close(graph.mean(values, rows), expected)


def test_a_restored_graph_has_the_same_neighbors_whatever_it_had_before():
    graph, other = (NeighborGraph(3, refresh_every=10) for _ in range(2))
    graph.refresh_(points(20), Operators())
    other.load_state_dict(graph.state_dict())
    assert torch.equal(other.rows, graph.rows)
