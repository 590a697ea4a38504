"""Simplification: rows made by hand that use a parameter of time or do not, and what they lose."""

import math

import pytest
import torch
from support.adaptive_splats import adaptive
from support.mixed_rows import check_rows, standing
from support.moving_splats import at

from gsfw.methods.moving.settling import settle
from gsfw.methods.spacetime.adaptive_model import MIDDLE
from gsfw.methods.spacetime.simplification import simplify

TOLERANCE, SIZE = 0.1, 0.05
INSTANTS = torch.linspace(0.0, 1.0, 21).tolist()


def resting(n: int = 4, duration: float = 0.5, **settings):
    """Round rows of one size that have everything, are there for a part of it, and do not move."""
    model, table = adaptive(n, **settings)
    columns = model.temporal_columns()
    with torch.no_grad():
        model.canonical.log_scales.values.fill_(math.log(SIZE))
        columns["time_centers"].values.copy_(torch.linspace(0.0, 1.0, n))
        columns["log_durations"].values.fill_(math.log(duration))
        for name in set(columns) - {"time_centers", "log_durations"}:
            columns[name].values.zero_()
    return model, table


def motion(model) -> torch.Tensor:
    """All coefficients of rows that have everything, to be changed."""
    return model.temporal_columns()["motion"].values.data.view(-1, model.order, 3)


def place(model, time: float) -> torch.Tensor:
    return model.splats(at(time)).means.detach()


def deviations(model) -> torch.Tensor:
    """How much of each row is there at all instants."""
    weights = [model.everywhere(model._weights(at(time)), 1.0) for time in INSTANTS]
    return torch.stack(weights).detach()


def test_rows_that_do_nothing_keep_what_says_when_they_are_there():
    model, table = resting()
    lost = simplify(model, table, TOLERANCE)
    assert lost == {"always_there": 0, "orders_lost": 12, "spins_lost": 4}
    assert model.lengths("motion").tolist() == [0] * 4
    assert model.lengths("time_centers").tolist() == [1] * 4
    assert len(model.columns()["spins"].values) == 0


def test_rows_keep_the_highest_power_that_they_use():
    model, table = resting(4, duration=3.0)
    with torch.no_grad():
        for order in range(1, 4):
            motion(model)[order, order - 1, 0] = 1.0
    simplify(model, table, TOLERANCE)
    assert model.lengths("motion").tolist() == [0, 1, 2, 3]


def test_a_row_loses_a_power_if_the_rest_can_nearly_do_without():
    # The closest straight line to a t^2 is a / 8 away from it over an interval of length 1 in the
    # maximum norm; in the least squares over nine equal steps it is 7 / 48 a at the ends.
    model, table = resting(2, duration=1e3)
    with torch.no_grad():
        motion(model)[:, 1, 1] = TOLERANCE * SIZE * 48 / 7 * torch.tensor([0.99, 1.01])
    before = {time: place(model, time) for time in INSTANTS}
    simplify(model, table, TOLERANCE)
    assert model.lengths("motion").tolist() == [1, 2]
    for time in INSTANTS:
        difference = (place(model, time) - before[time]).norm(dim=1)
        assert difference[0] <= TOLERANCE * SIZE
        assert difference[1] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("duration", [0.02, 0.1, 0.3, 1.0])
def test_while_they_are_there_rows_stay_where_they_were(duration):
    model, table = resting(40, duration)
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        sizes = torch.tensor([1.0, 0.3, 0.1])[:, None] * torch.rand(40, 1, 1, generator=generator)
        noise = torch.randn(40, 3, 3, generator=generator)
        reach = min(3 * duration, 1.0) ** torch.arange(1, 4)
        motion(model).copy_(0.6 * SIZE * sizes * noise / reach[:, None])
    before = torch.stack([place(model, time) for time in INSTANTS])
    weights = deviations(model)
    simplify(model, table, TOLERANCE)
    assert len(model.lengths("motion").unique()) > 1
    after = torch.stack([place(model, time) for time in INSTANTS])
    errors = weights * (after - before).norm(dim=2)
    # Between the times looked at it may be a little more.
    assert float(errors.max()) <= 1.3 * TOLERANCE * SIZE


def test_a_row_that_is_there_all_the_time_needs_no_centre_and_stays_on_its_path():
    model, table = resting(5)
    with torch.no_grad():
        model.temporal_columns()["log_durations"].values.copy_(
            torch.tensor([0.5, 1.0, 1.3, 3.0, 10.0]).log()
        )
        motion(model).copy_(torch.randn(5, 3, 3, generator=torch.Generator().manual_seed(0)))
        model.temporal_columns()["spins"].values.fill_(0.3)
        model.canonical.log_scales.values[:, 0] += 1.0
    before = {time: model.splats(at(time)) for time in INSTANTS}
    lost = simplify(model, table, TOLERANCE)
    # A centre in the middle (row 2) asks for a deviation of 1.09, one at an end (4) for twice that.
    assert model.lengths("time_centers").tolist() == [1, 1, 0, 0, 0]
    assert lost["always_there"] == 3
    assert model.centers().tolist() == pytest.approx([0.0, 0.25, MIDDLE, MIDDLE, MIDDLE])
    for time, earlier in before.items():
        now = model.splats(at(time))
        torch.testing.assert_close(now.means, earlier.means)
        torch.testing.assert_close(now.quats, earlier.quats)
        torch.testing.assert_close(now.opacities, earlier.opacities, rtol=TOLERANCE, atol=0)
    mean = torch.stack([splats.opacities for splats in before.values()]).mean(0)
    torch.testing.assert_close(model.opacities()[2:], mean[2:], rtol=5e-3, atol=0)


def test_a_row_that_turns_loses_its_rotation_only_if_it_is_round():
    model, table = resting()
    with torch.no_grad():
        model.canonical.log_scales.values[0, 0] += 1.0
        model.temporal_columns()["spins"].values[:2] = torch.tensor([0.0, 0, 0, 2]).double()
    simplify(model, table, TOLERANCE)
    assert model.lengths("spins").tolist() == [1, 0, 0, 0]


def test_a_row_that_hardly_turns_ends_up_as_it_is_on_average():
    model, table = resting(1, duration=1e3)
    with torch.no_grad():
        model.canonical.quats.values.copy_(torch.tensor([1.0, 0, 0, 0]))
        model.canonical.log_scales.values[0, 0] += 1.0
        model.temporal_columns()["spins"].values[0, 3] = 0.05
    middle = model.splats(at(0.5)).quats.detach()
    assert simplify(model, table, TOLERANCE)["spins_lost"] == 1
    torch.testing.assert_close(model.splats(at(0.0)).quats.detach(), middle)


def test_a_row_whose_features_change_keeps_their_rate():
    model, table = resting(colors="features")
    with torch.no_grad():
        model.temporal_columns()["feature_rates"].values[1] = 0.5
    assert simplify(model, table, TOLERANCE)["feature_rates_lost"] == 3
    assert model.lengths("feature_rates").tolist() == [0, 1, 0, 0]


def test_moments_of_what_is_left_go_on():
    model, table = resting(2, duration=3.0)
    with torch.no_grad():
        motion(model)[1, 1, 0] = 1.0
    (moments,) = table._optimizer.moments("motion")
    moments.first.copy_(torch.arange(18.0).view(6, 3))
    simplify(model, table, TOLERANCE)
    assert model.lengths("motion").tolist() == [0, 2]
    (left,) = table._optimizer.moments("motion")
    assert torch.equal(left.first, moments.first[3:5])


def test_no_row_and_one_row_are_no_exception():
    model, table = adaptive(2)
    for rows in ([1], []):
        table.keep(torch.tensor(rows, dtype=torch.int64))
        simplify(model, table, TOLERANCE)
        assert len(model.splats(at(0.5))) == len(rows)


# Together with rows that stand still.


def test_rows_that_have_just_begun_to_move_lose_nothing_until_their_term_is_over():
    model, table = standing("adaptive", 4)
    model.start_(table, torch.tensor([1, 2]), torch.full((2,), 0.5, dtype=torch.float64))
    assert set(simplify(model, table, TOLERANCE).values()) == {0}
    assert model.lengths("motion").tolist() == [0, 3, 3, 0]
    model.still.terms.values[:, 0] = 0
    assert simplify(model, table, TOLERANCE)["always_there"] == 2
    assert model.lengths("motion").tolist() == [0, 0, 0, 0]


def test_a_row_that_has_lost_everything_stands_still_and_moves_again_with_everything():
    model, table = standing("adaptive", 3)
    model.start_(table, torch.arange(3), torch.full((3,), 0.5, dtype=torch.float64))
    model.still.terms.values[:, 0] = 0
    simplify(model, table, TOLERANCE)
    assert settle(model, table, tolerance=TOLERANCE, signal=2.0)["stopped"] == 3
    check_rows(model, table)
    model.still.stillness.values[1, 0], model.still.stillness.values[1, 1] = 10.0, 10.0
    assert settle(model, table, tolerance=TOLERANCE, signal=2.0)["started"] == 1
    check_rows(model, table)
    assert model.lengths("motion").tolist() == [0, 3, 0]
