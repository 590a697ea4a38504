"""Budgets: the size of moving frames, and the share of the time of a run."""

import pytest

from gsfw.viewer.budget import LEAST_SCALE, FrameBudget
from gsfw.viewer.time_share import MOST_CREDIT, TimeShare

FULL = 1_000_000


def learnt(fixed, per_pixel):
    budget = FrameBudget()
    for pixels in (100_000, 400_000, FULL):
        budget.observe(pixels, fixed + per_pixel * pixels)
    return budget


def test_a_frame_that_fits_is_rendered_whole():
    assert learnt(0.001, 1e-8).scale(FULL, 0.05) == 1.0


def test_a_frame_fills_its_budget_where_it_does_not_fit():
    scale = learnt(0.01, 1e-7).scale(FULL, 0.05)
    assert 0.01 + 1e-7 * scale**2 * FULL == pytest.approx(0.05)


def test_a_fixed_part_beyond_the_budget_is_no_reason_for_tiny_frames():
    scale = learnt(0.2, 1e-7).scale(FULL, 0.05)
    assert scale == 1.0  # All its pixels take half as long as the rest.


def test_frames_are_never_unrecognisably_small():
    assert learnt(0.0, 1e-3).scale(FULL, 0.05) == LEAST_SCALE


def test_without_any_frame_the_first_one_is_small():
    assert FrameBudget().scale(FULL, 0.05) == 0.5


def test_one_size_alone_is_taken_for_a_time_per_pixel():
    budget = FrameBudget()
    budget.observe(FULL, 0.2)
    assert budget.scale(FULL, 0.05) == pytest.approx(0.5)


def run(share, frame_seconds, steps=400, step_seconds=0.1):
    """Train with pages that always want more: time of training, and of frames."""
    clock, trained, rendered = 0.0, 0.0, 0.0
    account = TimeShare(share, clock)
    for _ in range(steps):
        clock += step_seconds
        trained += step_seconds
        account.trained(clock)
        while account.allowed:
            clock += frame_seconds
            rendered += frame_seconds
            account.rendered(clock)
    return trained, rendered, account


@pytest.mark.parametrize("frame_seconds", [0.004, 0.05, 0.9])
@pytest.mark.parametrize("share", [0.05, 0.2, 0.5])
def test_frames_take_the_stated_share_and_no_more(share, frame_seconds):
    trained, rendered, account = run(share, frame_seconds)
    longest = frame_seconds + MOST_CREDIT
    assert rendered / (trained + rendered) <= share + longest / (trained + rendered)
    assert rendered >= 0.7 * share * (trained + rendered) - longest
    if frame_seconds < 0.1:
        assert account.measured == pytest.approx(share, abs=0.03)


def test_a_page_that_wants_little_saves_up_no_long_stop_of_the_run():
    account = TimeShare(0.5, 0.0)
    account.trained(1000.0)
    now = 1000.0
    while account.allowed:
        now += 0.01
        account.rendered(now)
    assert now - 1000.0 <= MOST_CREDIT + 0.02


def test_a_pause_counts_for_nobody():
    account = TimeShare(0.2, 0.0)
    account.trained(1.0)
    account.skip(500.0)
    account.trained(501.0)
    assert account.measured == 0.0


def test_steps_that_take_longer_beside_a_frame_are_paid_for():
    account, now = TimeShare(0.2, 0.0), 0.0
    for _ in range(10):
        now += 0.01
        account.trained(now)
    assert account.allowed
    assert account.measured == 0.0
    for _ in range(20):
        now += 0.018  # A browser and the threads of the page take processors from training.
        account.trained(now, disturbed=True)
    assert account.measured == pytest.approx(20 * 0.008 / (0.1 + 20 * 0.018))
    assert not account.allowed


def test_a_long_evaluation_beside_a_frame_is_not_charged_as_a_whole():
    account, now = TimeShare(0.5, 0.0), 0.0
    for _ in range(10):
        now += 0.01
        account.trained(now)
    account.trained(now + 30.0, disturbed=True)
    assert account.allowed
    assert account.measured < 0.01
