"""A window of times that grows."""

from collections import Counter
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.timed_views import timed_views

from gsfw.core.errors import ConfigError
from gsfw.samplers.progressive import ProgressiveConfig, window_sizes

TIMES = (0.0, 0.75, 0.25, 1.0, 0.5, 0.0, 0.25, 0.75)


def sampler(window=0.2, growth=0.4, grow_every=12, views_per_step=1, seed=0, steps=100):
    config = ProgressiveConfig(window, growth, grow_every, views_per_step)
    return config.build(timed_views(TIMES), seed, steps)


def test_the_window_grows_until_all_times_are_in():
    samples = sampler()
    stages = [{TIMES[samples.next()[0]] for _ in range(12)} for _ in range(5)]
    assert stages == [{0.0}, {0.0, 0.25, 0.5}, *[{0.0, 0.25, 0.5, 0.75, 1.0}] * 3]


def test_views_are_drawn_uniformly_within_the_window():
    samples = sampler(grow_every=10)
    stages = [Counter(samples.next()[0] for _ in range(10)) for _ in range(2)]
    assert stages == [{0: 5, 5: 5}, dict.fromkeys((0, 2, 4, 5, 6), 2)]
    rest = Counter(samples.next()[0] for _ in range(80))
    assert rest == dict.fromkeys(range(8), 10)


@settings(max_examples=60)
@given(st.integers(1, 300), st.floats(0.001, 1.0), st.floats(0.01, 1.0))
def test_every_stage_has_more_times_than_the_last_and_the_last_has_all(times, window, growth):
    sizes = window_sizes(times, window, growth)
    assert sizes[0] == max(int(window * times + 1e-6), 1) or len(sizes) == 1
    assert sizes[-1] == times
    assert all(after > before for before, after in pairwise(sizes))
    assert len(sizes) <= 1 / growth + 2


def test_the_paper_s_window_takes_a_thirtieth_of_the_times_at_once():
    assert window_sizes(300, 1 / 30, 1 / 30) == list(range(10, 301, 10))


def test_a_run_that_ends_before_all_times_are_in_is_refused():
    with pytest.raises(ConfigError) as caught:
        sampler(steps=24)
    assert str(caught.value) == (
        "sampler 'progressive': all 5 times are in after 24 steps, and the run has steps=24.\n"
        "Give a smaller sampler.grow_every, or a larger sampler.window or sampler.growth."
    )
    assert sampler(steps=25).next()


def test_views_without_times_are_refused():
    with pytest.raises(ConfigError) as caught:
        ProgressiveConfig().build(timed_views((None,)), 0, 30_000)
    assert str(caught.value) == (
        "sampler 'progressive': the views of this capture have no times.\nUse sampler=uniform."
    )
