import numpy as np
import pytest

from gsfw.core.errors import ConfigError
from gsfw.partition.cells import Cell, Weighted, balanced, grid, until


def items(count: int = 500, seed: int = 0) -> Weighted:
    generator = np.random.default_rng(seed)
    return Weighted.of(generator.normal(0, 3, (count, 2)), generator.normal(0, 1, (count // 10, 2)))


@pytest.mark.parametrize("count", [2, 3, 7])
def test_every_place_is_in_exactly_one_cell_however_far_out(count):
    cells = balanced(items(), count)
    places = np.random.default_rng(1).normal(0, 1000, (4000, 2))
    assert len(cells) == count
    assert (sum(cell.holds(places) for cell in cells) == 1).all()


def test_a_place_on_a_border_is_in_one_cell():
    left, right = Cell().split(0, 1.5)
    place = np.array([[1.5, 0.0]])
    assert not left.holds(place)[0]
    assert right.holds(place)[0]


def test_cells_have_alike_work():
    found = items(2000)
    work = [found.within(cell).total for cell in balanced(found, 5)]
    assert max(work) < 1.1 * min(work)


def test_a_grid_has_strips_of_cells():
    cells = grid(items(), 3, 2)
    assert len(cells) == 6
    assert len({(cell.low[0], cell.high[0]) for cell in cells}) == 3


def test_cells_are_halved_until_they_fit():
    found = items(2000)
    cells = until(found, lambda cell: found.within(cell).total < 0.3, 100)
    assert all(found.within(cell).total < 0.3 for cell in cells)
    assert len(cells) == 4


def test_halving_ends_at_the_most_cells_and_where_nothing_can_be_cut():
    found = items(300)
    assert len(until(found, lambda cell: False, 10)) == 10
    one = Weighted(np.zeros((5, 2)), np.ones(5))
    assert until(one, lambda cell: False, 10) == [Cell()]


def test_more_blocks_than_places_are_refused():
    few = Weighted(np.array([[0.0, 0.0], [1.0, 0.0]]), np.ones(2))
    with pytest.raises(ConfigError, match="too few points and cameras stand apart"):
        balanced(few, 5)
