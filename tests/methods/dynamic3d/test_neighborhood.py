"""Neighborhood: who is near whom, and how much that counts."""

import torch
from support.tracked_splats import after, tracked

from gsfw.core.operators import Operators
from gsfw.methods.dynamic3d.model import TrackedGaussians
from gsfw.methods.dynamic3d.neighborhood import Neighborhood

LIKE = torch.zeros(0, dtype=torch.float64)


def neighborhood(model: TrackedGaussians, per_step: int = 6) -> Neighborhood:
    return Neighborhood(model.trajectory, 6, per_step, Operators())


def test_all_neighbors_have_their_turn_once():
    model = after((0.0, 1.0))
    whole = neighborhood(model).some(0, model.trajectory, LIKE).rows
    assert whole.shape == (20, 6)
    first = model.trajectory.stored(0, LIKE).means
    assert torch.equal(whole, Operators().neighbors(first, 6))
    for count, turns in ((4, 2), (2, 3), (1, 6)):
        made = neighborhood(model, count)
        rows = [made.some(step, model.trajectory, LIKE).rows for step in range(turns)]
        assert torch.equal(torch.cat(rows, dim=1).sort(1).values, whole.sort(1).values)
        again = made.some(turns, model.trajectory, LIKE).rows
        assert torch.equal(again, rows[0])


def test_steps_of_fixed_shapes_read_the_same_neighbors_at_one_place(monkeypatch):
    model = after((0.0, 0.5))
    usual = neighborhood(model, 4)  # Turns of 3 neighbours.
    monkeypatch.setattr(Operators, "fixed_shapes", True)
    staying = neighborhood(model, 4)
    places = set()
    for step in (0, 1, 2, 3, 3, 4, 6):
        if step == 4:
            model.advance_(1.0)
        expected = usual.some(step, model.trajectory, LIKE)
        found = staying.some(step, model.trajectory, LIKE)
        for name in ("rows", "weights", "previous", "lengths"):
            assert torch.equal(getattr(found, name), getattr(expected, name)), (step, name)
        assert staying.number(step) == 3
        places.add(found.previous.data_ptr())
    assert len(places) == 1


def test_turns_of_unequal_numbers_have_places_of_their_own(monkeypatch):
    monkeypatch.setattr(Operators, "fixed_shapes", True)
    model = after((0.0, 1.0))
    made = neighborhood(model, 5)
    made_of_five = Neighborhood(model.trajectory, 5, 3, Operators())
    assert [made.number(step) for step in range(3)] == [3, 3, 3]
    assert [made_of_five.number(step) for step in range(3)] == [3, 2, 3]
    for step in range(3):
        rows = made_of_five.some(step, model.trajectory, LIKE).rows
        assert rows.shape == (20, made_of_five.number(step))
    whole = [made_of_five.some(step, model.trajectory, LIKE).rows.clone() for step in range(2)]
    expected = Operators().neighbors(model.trajectory.stored(0, LIKE).means, 5)
    assert torch.equal(torch.cat(whole, dim=1).sort(1).values, expected.sort(1).values)


def test_offsets_are_of_the_previous_time_and_lengths_of_the_first():
    model = after((0.0, 0.5, 1.0))
    known = neighborhood(model).some(0, model.trajectory, LIKE)
    first, previous = (model.trajectory.stored(index, LIKE).means for index in (0, 1))
    torch.testing.assert_close(known.previous, previous[known.rows] - previous[:, None])
    torch.testing.assert_close(
        known.lengths, (first[known.rows] - first[:, None]).norm(dim=2), atol=1e-6, rtol=1e-6
    )


def test_weights_fall_with_distance_whatever_the_units():
    model, large = after((0.0, 1.0)), after((0.0, 1.0))
    large.trajectory.columns()["past_means"].values.mul_(1000.0)
    weights = neighborhood(model).some(0, model.trajectory, LIKE).weights
    assert bool((weights.diff(dim=1) <= 0).all()), "neighbours come nearest first"
    assert 0.3 < float(weights.median()) < 0.5, "exp(-1) at the median distance"
    scaled = neighborhood(large).some(0, large.trajectory, LIKE).weights
    torch.testing.assert_close(scaled, weights, atol=1e-5, rtol=1e-4)


def test_a_row_that_stands_alone_is_held_by_neighbours_of_its_own_scale():
    model = tracked(n=20)
    model.canonical.means.values.data[0] = torch.tensor([50.0, 0.0, 0.0])
    model.advance_(0.0)
    model.advance_(1.0)
    weights = neighborhood(model).some(0, model.trajectory, LIKE).weights
    assert float(weights[0].median()) > 0.3


def test_fewer_rows_than_neighbours_are_no_reason_to_fail():
    for rows in (1, 2, 4):
        model = after((0.0, 1.0), n=rows)
        known = neighborhood(model).some(0, model.trajectory, LIKE)
        own = known.rows == torch.arange(rows)[:, None]
        assert not bool(known.weights[own].any())
        assert bool(known.weights.isfinite().all())
    assert neighborhood(model).fits(4)
    assert not neighborhood(model).fits(5)


def test_offsets_follow_when_a_time_is_finished():
    model = after((0.0, 0.5))
    made = neighborhood(model)
    before = made.some(0, model.trajectory, LIKE)
    assert made.some(0, model.trajectory, LIKE) is before, "worked out once for each time"
    model.advance_(1.0)
    now = made.some(0, model.trajectory, LIKE)
    assert not torch.equal(now.previous, before.previous)
    assert torch.equal(now.lengths, before.lengths)
