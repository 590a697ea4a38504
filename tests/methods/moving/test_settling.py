"""Settling: rows made by hand that stand still, or do not, and what they become."""

import math

import pytest
import torch
from support.mixed_rows import check_rows, shake_, standing
from support.moving_splats import at

from gsfw.methods.moving.covariances import covariances
from gsfw.methods.moving.settling import settle
from gsfw.methods.moving.still_rows import FIRST_TERM

TOLERANCE, SIGNAL = 0.1, 2.0
SIZE = 0.05


def all_moving(method: str = "spacetime", n: int = 4):
    """Round rows of one size that all have parameters of time, and do not use them."""
    model, table = standing(method, n)
    with torch.no_grad():
        model.canonical.log_scales.values.fill_(math.log(SIZE))
    model.start_(table, torch.arange(n), torch.full((n,), 0.5, dtype=torch.float64))
    return model, table


def look(model, table, times: int = int(FIRST_TERM)):
    """What happens in so many looks."""
    total = {"stopped": 0, "started": 0}
    for _ in range(times):
        for verb, number in settle(model, table, tolerance=TOLERANCE, signal=SIGNAL).items():
            total[verb] += number
    return total


def test_rows_that_do_nothing_stop_once_their_term_is_over():
    model, table = all_moving()
    assert look(model, table, int(FIRST_TERM) - 1) == {"stopped": 0, "started": 0}
    assert look(model, table, 1) == {"stopped": 4, "started": 0}
    check_rows(model, table)
    assert len(model.columns()["motion"].values) == 0


def test_a_row_stops_if_it_moves_by_less_than_the_tolerance_of_its_size():
    model, table = all_moving()
    with torch.no_grad():  # Straight paths: from one end to the other, twice the reach.
        model.columns()["motion"].values[:, 0, 0] = 2 * SIZE * torch.tensor([0.05, 0.09, 0.11, 1.0])
    assert look(model, table) == {"stopped": 2, "started": 0}
    assert model.still.rows().tolist() == [0, 1]


def test_a_row_that_fades_does_not_stop():
    model, table = all_moving()
    with torch.no_grad():
        model.columns()["log_durations"].values[0] = math.log(0.5)
    look(model, table)
    assert model.still.moving().tolist() == [0]


def test_a_row_that_turns_stops_only_if_it_is_round():
    model, table = all_moving()
    with torch.no_grad():
        model.canonical.log_scales.values[0, 0] += 1
        model.columns()["spins"].values[:2] = torch.tensor([0.0, 0, 0, 2]).double()
    look(model, table)
    assert model.still.moving().tolist() == [0]


def test_a_row_whose_features_change_does_not_stop():
    model, table = all_moving("features")
    with torch.no_grad():
        model.columns()["feature_rates"].values[1] = 0.5
    look(model, table)
    assert model.still.moving().tolist() == [1]


@pytest.mark.parametrize("method", ["spacetime", "4d-rotor", "two-quaternions", "4dgs"])
def test_a_row_that_stops_becomes_what_it_is_on_average(method):
    model, table = all_moving(method, 12)
    with torch.no_grad():
        model.canonical.log_scales.values.add_(torch.linspace(-0.5, 0.5, 3))
    shake_(model, 1e-3)
    columns = model.temporal_columns()
    if "log_durations" in columns:
        columns["log_durations"].values.data.fill_(math.log(5.0))
    before = [model.splats(at(time)) for time in (0.0, 0.5, 1.0)]
    stopped = look(model, table)["stopped"]
    assert stopped > 0
    rows, after = model.still.rows(), model.splats(at(0.5))
    middle = torch.stack([splats.means for splats in before]).mean(0)
    torch.testing.assert_close(after.means[rows], middle[rows], atol=2e-3, rtol=0)
    torch.testing.assert_close(after.opacities[rows], before[1].opacities[rows], atol=0.02, rtol=0)
    torch.testing.assert_close(shapes(after)[rows], shapes(before[1])[rows], rtol=0.02, atol=1e-6)
    check_rows(model, table)


def shapes(splats) -> torch.Tensor:
    """Covariances in either form."""
    if splats.covariances is not None:
        return splats.covariances
    return covariances(splats.quats, splats.scales)


def test_rows_start_by_their_evidence_and_others_do_not():
    model, table = standing("spacetime", 4)
    model.still.stillness.values[2, 0] = 10.0  # Ten steps, all pulling one way where phi is 1.
    model.still.stillness.values[:, 1] = 10.0
    assert look(model, table, 1) == {"stopped": 0, "started": 1}
    assert model.still.moving().tolist() == [2]
    check_rows(model, table)


def test_a_row_that_comes_and_goes_does_so_less_and_less_often():
    model, table = standing("spacetime", 2)
    changes = []
    for _ in range(40):
        moves = model.still.moving().tolist() == [1]
        if not moves:  # Evidence, which its path does not follow.
            model.still.stillness.values[1, 0], model.still.stillness.values[1, 1] = 10.0, 10.0
        look(model, table, 1)
        changes.append((model.still.moving().tolist() == [1]) != moves)
    gaps = [index for index, changed in enumerate(changes) if changed]
    assert gaps[:6] == [0, 4, 5, 13, 14, 30]


def test_standing_rows_have_no_fourth_axis_to_be_thin_along():
    model, table = all_moving("4d-rotor", 3)
    with torch.no_grad():
        model.canonical.log_scales.values[0] = torch.tensor([1e-9, 0.05, 0.05]).log()
    look(model, table)
    scales = model.canonical.log_scales.values[0].detach().exp()
    assert (scales.min() / scales.max()).item() == pytest.approx(1e-4, rel=1e-3)
