"""Still rows: what counts as a sign that a row needs time, and what does not."""

import math

import pytest
import torch
from support.scenes import random_splats

from gsfw.methods.moving.still_rows import FIRST_TERM, StillRows

# Whole trainings and scenes; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

NUM_STEPS = 200


def watched(pull, seed: int = 0, n: int = 12) -> StillRows:
    """Rows whose gradient at time t is ``pull(t)`` times ones, plus noise of deviation 1."""
    still, generator = StillRows(n, all_still=True), torch.Generator().manual_seed(seed)
    for _ in range(NUM_STEPS):
        time = torch.rand((), generator=generator)
        splats = random_splats(n).map(lambda values: values.requires_grad_())
        still.watch(splats, time)
        noise = torch.randn(n, 4, generator=generator)
        gradient = noise + pull(float(time))
        (splats.means * gradient[:, :3]).sum().backward()
        (splats.opacities * gradient[:, 3]).sum().backward()
    return still


def test_gradients_that_have_nothing_to_do_with_time_are_no_signal():
    signals = watched(lambda time: 0.0).signals()
    assert signals.mean().item() == pytest.approx(1.0, abs=0.2)
    assert float(signals.max()) < 1.8


def test_a_gradient_that_is_the_same_at_all_times_is_no_signal():
    assert float(watched(lambda time: 3.0).signals().max()) < 1.8


@pytest.mark.slow
@pytest.mark.parametrize("wave", [1, 2])
def test_a_gradient_that_follows_time_is_a_signal_at_any_size(wave):
    signals = watched(lambda time: math.cos(wave * math.pi * time)).signals()
    assert float(signals.min()) > 3
    tiny = watched(lambda time: math.cos(wave * math.pi * time))
    tiny.stillness.values.copy_(
        tiny.stillness.values * torch.tensor([1e-9, 1e-18]).view(1, 2, 1, 1)
    )
    torch.testing.assert_close(tiny.signals(), signals)


def test_rows_that_no_view_has_seen_give_no_signal():
    assert float(StillRows(3, all_still=True).signals().abs().max()) == 0


def test_a_gradient_that_is_not_finite_is_not_noted():
    still = StillRows(2, all_still=True)
    splats = random_splats(2).map(lambda values: values.requires_grad_())
    still.watch(splats, torch.tensor(0.0))
    (splats.means * torch.tensor([math.nan, math.inf, 1.0])).sum().backward()
    assert bool(still.stillness.values.isfinite().all())


def test_nothing_is_noted_of_what_is_drawn_without_a_graph():
    still = StillRows(2, all_still=True)
    still.watch(random_splats(2), torch.tensor(0.0))
    assert not still.stillness.values.any()


def test_a_parameter_that_is_drawn_as_it_is_is_watched_once():
    still, splats = StillRows(2, all_still=True), random_splats(2)
    splats.means.requires_grad_()
    splats.opacities.requires_grad_()
    still.watch(splats, torch.tensor(0.0))
    for _ in range(2):
        splats.means.sum().backward()
    torch.testing.assert_close(still.stillness.values[:, 0, :, 0], torch.ones(2, 2))


@pytest.mark.slow
def test_the_time_at_which_opacity_is_wanted_is_where_its_gradient_is_most_negative():
    early = watched(lambda time: -3 * math.cos(math.pi * time))
    middle = watched(lambda time: 3 * math.cos(2 * math.pi * time))
    assert float(early.wanted().max()) < 0.2
    assert middle.wanted().tolist() == pytest.approx([0.5] * 12, abs=0.1)


def test_old_evidence_weighs_less_and_alone_remains_the_signal_it_was():
    still = watched(lambda time: math.cos(math.pi * time))
    before = still.signals()
    still.forget_()
    torch.testing.assert_close(still.signals(), before)


def test_each_time_a_row_begins_to_move_it_goes_on_for_twice_as_long():
    still, rows = StillRows(2, all_still=True), torch.tensor([1])
    assert still.patient().tolist() == [True, True]
    for term in (FIRST_TERM, 2 * FIRST_TERM):
        still.extend_(rows)
        looks = [still.patient().tolist() for _ in range(int(term))]
        assert looks == [[True, False]] * (int(term) - 1) + [[True, True]]
