"""The goal of a run: a PSNR, or the point from which more steps do not pay."""

import pytest

from gsfw.core.loop.goal import EVERY, GAIN, LEAST_LAST, LEAST_UPDATES, Goal


def reached(goal: Goal, psnr, until: int = 20_000) -> int | None:
    """Number of updates at which a run with this PSNR reaches its goal."""
    for updates in range(EVERY, until, EVERY):
        assert goal.due(updates)
        if goal.judge(updates, psnr(updates)):
            return updates
    return None


def test_the_last_part_begins_where_its_gain_leads_to_the_psnr():
    goal = Goal(25.0 + GAIN)
    assert reached(goal, lambda updates: 20 + updates / 1000) == 5000
    assert goal.last_updates() == 1250
    assert not goal.due(5100), "one verdict is enough"


def test_a_psnr_that_never_comes_is_never_reached():
    assert reached(Goal(60.0), lambda updates: 30.0) is None


def test_steps_stop_paying_where_the_curve_is_flat():
    found = reached(Goal(None), lambda updates: 30 - 10 * 0.5 ** (updates / 500))
    assert found is not None
    assert 2500 <= found <= 6000


def test_a_curve_that_rises_goes_on():
    assert reached(Goal(None), lambda updates: 20 + updates / 2000) is None


def test_an_opacity_reset_is_no_end():
    def with_resets(updates: int) -> float:
        since = updates % 2000
        return 20 + updates / 1000 - (8.0 if since < 200 else 0.0)

    assert reached(Goal(None), with_resets) is None


def test_nothing_is_said_before_enough_updates_and_the_last_part_has_some():
    goal = Goal(None)
    first = reached(goal, lambda updates: 30.0)
    assert first is not None
    assert first >= LEAST_UPDATES
    short = Goal(1.0)
    short.judge(EVERY, 30.0)
    assert short.last_updates() == LEAST_LAST


def test_a_goal_that_goes_on_knows_its_looks():
    goal, again = Goal(None), Goal(None)
    goal.judge(EVERY, 20.0)
    again.load_state_dict(goal.state_dict())
    assert again.looks == [(EVERY, 20.0)]
    assert again.reached is None


@pytest.mark.parametrize("updates", [1, EVERY - 1, EVERY + 1])
def test_looks_are_regular(updates):
    assert not Goal(None).due(updates)
