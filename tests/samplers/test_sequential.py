"""One time after the other."""

from itertools import groupby, pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.timed_views import timed_views

from gsfw.core.errors import ConfigError
from gsfw.samplers.sequential import SequentialConfig, time_starts

TIMES = (0.0, 0.5, 0.0, 1.0, 0.5, 0.0, 1.0, 0.25, 0.0)
"""Not in order, and unevenly many views per time: 4, 1, 2, 2."""


def sampler(first_steps=8, views_per_step=2, seed=0, steps=23):
    return SequentialConfig(first_steps, views_per_step).build(timed_views(TIMES), seed, steps)


def test_times_come_in_order_and_share_what_the_first_one_leaves():
    samples = sampler()
    seen = [{TIMES[view] for view in samples.next()} for _ in range(23)]
    runs = [(time, len(list(steps))) for time, steps in groupby(seen)]
    assert runs == [({0.0}, 8), ({0.25}, 5), ({0.5}, 5), ({1.0}, 5)]


def test_the_run_ends_on_the_last_time_whatever_does_not_divide():
    assert time_starts(4, 10, 10 + 3 * 5 + 2) == (0, 10, 15, 21)
    assert time_starts(1, 10, 5) == (0,)


@settings(max_examples=50)
@given(st.integers(2, 40), st.integers(1, 50), st.integers(0, 300))
def test_every_time_gets_its_even_share(times, first, more):
    steps = first + times - 1 + more
    lengths = [
        after - before for before, after in pairwise((*time_starts(times, first, steps), steps))
    ]
    assert lengths[0] == first
    assert sum(lengths) == steps
    assert lengths[1:] == sorted(lengths[1:])
    assert lengths[-1] - lengths[1] <= 1 <= lengths[1]


def test_within_a_time_every_view_comes_once_per_epoch_in_an_order_of_its_own():
    samples = sampler(first_steps=40, steps=60)
    epochs = [(*samples.next(), *samples.next()) for _ in range(20)]
    assert all(sorted(epoch) == [0, 2, 5, 8] for epoch in epochs)
    assert len(set(epochs)) > 5


def test_a_step_draws_no_more_views_than_its_time_has():
    samples = sampler(views_per_step=3)
    sizes = [len(samples.next()) for _ in range(23)]
    assert sizes == [3] * 8 + [1] * 5 + [2] * 10


def test_a_run_that_goes_on_stays_at_the_last_time():
    samples = sampler()
    for _ in range(100):
        views = samples.next()
    assert {TIMES[view] for view in views} == {1.0}


@pytest.mark.parametrize(("first_steps", "left"), [(8, 2), (10, 0), (500, 0)])
def test_too_few_steps_for_the_times_are_refused(first_steps, left):
    with pytest.raises(ConfigError) as caught:
        sampler(first_steps, steps=10)
    assert str(caught.value) == (
        f"sampler 'sequential': steps=10 less sampler.first_steps={first_steps} leaves {left} "
        "steps for 3 further times, and each needs one.\n"
        f"Give steps={first_steps + 3} or more, or a smaller sampler.first_steps."
    )


def test_views_without_times_are_refused():
    with pytest.raises(ConfigError) as caught:
        SequentialConfig().build(timed_views((None, None)), 0, 30_000)
    assert str(caught.value) == (
        "sampler 'sequential': the views of this capture have no times.\nUse sampler=uniform."
    )
