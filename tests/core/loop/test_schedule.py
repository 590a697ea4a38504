"""When a run evaluates and writes checkpoints: not twice at its end, not after a reset."""

import pytest

from gsfw.core.loop.schedule import RECOVERY, checkpoint_due, evaluation_due


def evaluated(steps: int, every: int, resets: tuple[int, ...] = ()) -> list[int]:
    return [s for s in range(steps + 1) if evaluation_due(s, steps, every, resets.__contains__)]


def saved(steps: int, every: int) -> list[int]:
    return [step for step in range(1, steps + 1) if checkpoint_due(step, steps, every)]


def test_evaluations_come_at_regular_steps_and_the_end_is_not_among_them():
    assert evaluated(3000, 1000) == [1000, 2000]
    assert evaluated(3000, 0) == []


@pytest.mark.parametrize("due", [evaluated, saved])
def test_what_falls_just_before_the_end_waits_for_it(due):
    # The interval of a run of 800 steps is a sixth of it, 133: six of them end at 798.
    assert due(800, 133) == [133, 266, 399, 532, 665]


def test_checkpoints_come_at_regular_steps_and_at_an_end_that_is_one():
    assert saved(3000, 1000) == [1000, 2000, 3000]
    assert saved(10, 0) == []


def test_an_evaluation_shortly_after_a_reset_comes_before_it():
    assert evaluated(4000, 1000, resets=(2000,)) == [1000, 1999, 3000]
    assert evaluated(4000, 1000, resets=(1950, 3000 - RECOVERY)) == [1000, 1949, 3000]


def test_evaluations_that_move_to_one_step_are_one():
    assert evaluated(500, 50, resets=(200,)) == [50, 100, 150, 199, 300, 350, 400, 450]


def test_resets_after_every_step_leave_evaluations_at_the_last_one_before():
    assert evaluated(40, 10, resets=tuple(range(1, 41))) == [9, 19, 29]
