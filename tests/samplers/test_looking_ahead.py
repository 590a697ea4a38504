"""Samplers whose order is known in advance: looking ahead, and going on from a stored state."""

import pytest
from support.states import assert_same_bits
from support.timed_views import timed_views

from gsfw.samplers.progressive import ProgressiveConfig
from gsfw.samplers.same_time import SameTimeConfig
from gsfw.samplers.sequential import SequentialConfig
from gsfw.samplers.uniform import UniformConfig

TIMES = (0.0, 0.5, 0.0, 1.0, 0.5, 0.0, 1.0, 0.25, 0.0)
CONFIGS = (
    UniformConfig(views_per_step=3),
    SameTimeConfig(views_per_step=2),
    SequentialConfig(first_steps=8, views_per_step=2),
    ProgressiveConfig(window=0.2, growth=0.4, grow_every=12, views_per_step=3),
)


@pytest.mark.parametrize("config", CONFIGS, ids=lambda config: type(config).__name__)
def test_looking_ahead_is_exact_and_a_restored_sampler_continues(config):
    samples, other = (config.build(timed_views(TIMES), 3, 100) for _ in range(2))
    for _ in range(9):
        samples.next()
    state = samples.state_dict()
    ahead = samples.peek(40)
    assert_same_bits(samples.state_dict(), state)
    following = [samples.next() for _ in range(40)]
    assert [view for step in following for view in step][:40] == list(ahead)
    other.load_state_dict(state)
    assert [other.next() for _ in range(40)] == following
