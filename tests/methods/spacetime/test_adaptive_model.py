"""Spacetime Gaussians with only the parameters of time that each needs."""

import math

import pytest
import torch
from support.adaptive_splats import adaptive, ragged
from support.model_gradients import check_gradients, drawn
from support.moving_splats import at, seeded, spacetime

from gsfw.methods.spacetime.adaptive_model import MIDDLE, _CountedPlaces
from gsfw.methods.spacetime.places import Places

TIMES = (0.0, 0.31, 1.0)


@pytest.mark.parametrize("colors", ["sh", "features"])
def test_rows_that_have_everything_are_drawn_as_by_the_papers_model(colors):
    model, full = adaptive(30, colors=colors)[0], spacetime(n=30, colors=colors)
    for name, column in full.columns().items():
        values = column.values.detach()
        flat = values.flatten(0, 1) if name == "motion" else values
        model.columns()[name].values.data.copy_(flat)
    for time in TIMES:
        all_rows, some = model.splats(at(time)), full.splats(at(time))
        rows = torch.arange(30) if some.rows is None else some.rows
        for name, tensor in some.tensors().items():
            torch.testing.assert_close(all_rows.tensors()[name][rows], tensor, rtol=1e-12, atol=0)


def test_rows_without_a_parameter_are_drawn_without_it():
    model, _ = ragged()
    column = {name: found.values.detach() for name, found in model.columns().items()}
    starts = {name: found.offsets for name, found in model.temporal_columns().items()}
    for time in TIMES:
        splats = model.splats(at(time))
        assert splats.rows is None
        for row in range(12):
            elapsed, weight = time - MIDDLE, 1.0
            if row % 3:
                value = int(starts["time_centers"][row])
                elapsed = time - float(column["time_centers"][value])
                deviation = math.exp(float(column["log_durations"][value]))
                weight = math.exp(-(elapsed**2) / (2 * deviation**2))
            mean, first = column["means"][row].clone(), int(starts["motion"][row])
            for power in range(row % 4):
                mean += column["motion"][first + power] * elapsed ** (power + 1)
            quat = column["quats"][row].clone()
            if row % 5:
                quat += column["spins"][int(starts["spins"][row])] * elapsed
            torch.testing.assert_close(splats.means[row].detach(), mean)
            torch.testing.assert_close(splats.quats[row].detach(), quat)
            opacity = model.opacities()[row] * weight
            torch.testing.assert_close(splats.opacities[row].detach(), opacity)


@pytest.mark.parametrize("colors", ["sh", "features"])
def test_gradients_agree_with_difference_quotients(colors):
    model, _ = ragged(8, colors=colors)
    check_gradients(model, lambda: drawn(model, at(0.6)), without=("time_centers",))


def test_drawing_neither_counts_nor_reads_once_rows_are_known():
    model, _ = ragged()
    counted = {name: Places.of(model.lengths(name)) for name in model.temporal_columns()}
    model = model.to("meta")  # Where tensors have no values that could be read.
    model.__dict__["_places_by_name"] = {
        name: _CountedPlaces(
            column.offsets,
            Places(counted[name].rows.to("meta"), counted[name].within.to("meta")),
            0,
        )
        for name, column in model.temporal_columns().items()
    }
    splats = model.splats(torch.empty((), device="meta"))
    (splats.means.sum() + splats.opacities.sum()).backward()
    assert splats.means.shape == (12, 3)


def test_rows_are_found_anew_once_they_were_edited():
    model, table = ragged()
    before = model.splats(at(0.2)).means.detach()
    table.keep(torch.tensor([7, 2, 3]))
    torch.testing.assert_close(model.splats(at(0.2)).means.detach(), before[[7, 2, 3]])


# Rows.


def paths(children, time: float) -> torch.Tensor:
    """Where new rows are."""
    count = len(children["means"].values)
    centers = torch.full((count,), MIDDLE, dtype=torch.float64)
    timed = children["time_centers"].lengths.bool()
    centers[timed] = children["time_centers"].values
    motion = Places.of(children["motion"].lengths).padded(children["motion"].values, count, 3)
    powers = (time - centers)[:, None] ** torch.arange(1, 4)
    return children["means"].values + (powers[:, :, None] * motion).sum(1)


def test_clones_stay_on_their_paths_and_have_what_their_parents_have():
    model, table = ragged()
    rows = torch.arange(12)
    same, apart = model.clone_rows(rows), model.clone_rows(rows, seeded())
    for time in TIMES:
        torch.testing.assert_close(paths(apart, time), paths(same, time))
    for name in model.temporal_columns():
        assert torch.equal(apart[name].lengths, model.lengths(name)), name
    moved = apart["time_centers"].values
    assert not torch.isclose(moved, same["time_centers"].values).any()
    before = model.splats(at(0.3)).quats.detach()
    table.append(apart)
    torch.testing.assert_close(model.splats(at(0.3)).quats.detach()[12:], before)


def test_children_of_a_split_go_along_with_their_parents():
    model, table = ragged()
    rows = torch.tensor([3, 5, 10])
    children, parents = model.split_rows(rows, 2, seeded()), model.clone_rows(rows.repeat(2))
    offsets = [paths(children, time) - paths(parents, time) for time in TIMES]
    assert bool(offsets[0].any())
    torch.testing.assert_close(offsets[0], offsets[1])
    torch.testing.assert_close(offsets[0], offsets[2])
    table.append(children)
    assert model.lengths("motion")[12:].tolist() == [3, 1, 2, 3, 1, 2]


def test_relocated_rows_look_as_one_did_and_keep_their_number_of_values():
    model, table = ragged()
    rows, before = torch.tensor([3, 6]), model.splats(at(0.4))
    table.replace(rows, model.relocated(rows, torch.tensor([2, 3])))
    after = model.splats(at(0.4))
    torch.testing.assert_close(after.means, before.means)
    assert bool((after.opacities[rows] < before.opacities[rows]).all())


def test_new_rows_have_everything():
    model, table = ragged()
    points, sizes = torch.rand(2, 3, generator=seeded()).double(), torch.full((2,), 0.1).double()
    table.append(model.rows_at(points, points, sizes, 0.3))
    lengths = {name: model.lengths(name)[12:].tolist() for name in model.temporal_columns()}
    assert lengths == {
        "time_centers": [1, 1], "log_durations": [1, 1], "motion": [3, 3], "spins": [1, 1],
    }  # fmt: skip
    torch.testing.assert_close(model.splats(at(0.9)).means[12:].detach(), points)


def test_what_strategies_ask_for_knows_rows_that_are_there_always():
    model, _ = ragged()
    lifetimes = model.lifetimes()
    assert lifetimes[::3].tolist() == [1.0] * 4
    assert float(lifetimes[1]) < 0.99
    assert model.time_gradients() is None
    model.splats(at(0.3)).opacities.sum().backward()
    gradients = model.time_gradients()
    assert gradients[::3].tolist() == [0.0] * 4
    assert float(gradients[1]) > 0


def test_a_model_says_what_its_rows_have():
    model, _ = ragged()
    found = model.census()
    assert found == {
        "rows_of_order_0": 3, "rows_of_order_1": 3, "rows_of_order_2": 3, "rows_of_order_3": 3,
        "rows_always_there": 4, "rows_that_turn": 9,
        "time_floats": 3 * (3 + 6 + 9) + 2 * 8 + 4 * 9, "time_floats_full": 12 * (9 + 2 + 4),
    }  # fmt: skip
    assert model.summary()["rows_always_there"] == 4
    everything, _ = adaptive()
    saved = found["time_floats_full"] - found["time_floats"]
    smaller = everything.summary()["model_bytes"] - model.summary()["model_bytes"]
    assert smaller == 8 * saved
