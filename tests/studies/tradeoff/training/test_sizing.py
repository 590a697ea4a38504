"""Steps and size fill the time, by speeds that were measured."""

import pytest

from gsfw.core.errors import ConfigError
from gsfw.studies.tradeoff.training.sizing import (
    PROBE_STEPS,
    USED,
    Speed,
    Work,
    choose,
    round_down,
    sizes,
)

WORK = Work(choices=8, lengths=(0.25, 0.5, 1.0), jobs=2)


def left() -> float:
    return 15.0


def measure(step_seconds, calls, faster=1.0):
    """Speeds by downscale; steps of longer runs may be faster."""

    def speeds(factors, steps):
        calls.append((list(factors), steps))
        gain = faster if steps > PROBE_STEPS else 1.0
        return [Speed(factor, step_seconds / factor / gain, 5.0) for factor in factors]

    return speeds


def test_what_is_chosen_fits():
    calls = []
    sizing = choose(WORK, 100, (1.0, 2.0, 4.0), None, measure(0.05, calls), left)
    assert calls[0] == ([1.0, 2.0, 4.0], PROBE_STEPS)
    assert sizing.downscale == 2.0, "the finest with 30 passes over 100 views"
    assert sizing.steps >= 3000
    assert sizing.seconds <= 15 * 60 * USED
    more = WORK.seconds(Speed(2.0, sizing.step_seconds, 5.0), round(sizing.steps * 1.1))
    assert more > 15 * 60 * USED, "and hardly more would"


def test_where_runs_will_be_long_a_longer_one_says_how_fast_they_are():
    calls = []
    sizing = choose(WORK, 100, (1.0, 2.0, 4.0), None, measure(0.05, calls, faster=2.0), left)
    assert calls[1] == ([1.0, 2.0], 1200)
    assert sizing.downscale == 1.0, "it has time for as many steps now"
    assert sizing.step_seconds == 0.025


def test_what_was_given_stays():
    sizing = choose(WORK, 100, (4.0,), None, measure(0.9, []), left)
    assert sizing.downscale == 4.0
    for steps in (40, 5000):
        assert choose(WORK, 100, (1.0, 2.0), steps, measure(0.1, []), left).steps == steps


def test_a_size_that_was_not_measured_in_time_is_not_chosen():
    def slow(factors, steps):
        return measure(0.01, [])([factor for factor in factors if factor > 2.0], steps)

    assert choose(WORK, 100, (1.0, 2.0, 4.0), None, slow, left).downscale == 4.0


def test_where_there_is_no_time_for_a_longer_measurement_the_short_one_has_to_do():
    def hurried(factors, steps):
        return measure(0.05, [])(factors, steps) if steps == PROBE_STEPS else []

    assert choose(WORK, 100, (1.0, 2.0, 4.0), None, hurried, left).step_seconds == 0.025


def test_no_time_to_measure_anything_is_told():
    with pytest.raises(ConfigError) as caught:
        choose(WORK, 100, (1.0,), None, lambda factors, steps: [], lambda: 0.1)
    assert str(caught.value.message) == (
        "budget.minutes: the 0.1 minutes that are left are not enough to measure how long steps "
        "take."
    )
    assert caught.value.advice == "Give more, or steps and downscale: then nothing is measured."


def test_too_little_time_says_how_much_is_needed():
    with pytest.raises(ConfigError) as caught:
        choose(WORK, 100, (1.0,), None, measure(0.1, []), lambda: 2.0)
    assert str(caught.value.message) == (
        "budget.minutes: in the 2.0 minutes that are left runs would have 66 steps, which says "
        "nothing."
    )
    assert caught.value.advice == (
        "Measuring aside, about 2.4 are needed here; or give fewer axes, or a larger downscale."
    )


def test_images_keep_64_pixels():
    assert list(sizes(400, 300)) == [1.0, 2.0, 4.0]
    assert list(sizes(40, 30)) == [1.0]


def test_steps_have_two_digits():
    assert [round_down(steps) for steps in (1799.0, 99.5, 7.2, -3.0)] == [1700, 99, 7, 0]
