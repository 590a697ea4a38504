"""Several views of one time."""

import pytest
from support.timed_views import timed_views

from gsfw.core.errors import ConfigError
from gsfw.samplers.same_time import SameTimeConfig

TIMES = (0.0, 0.5, 0.0, 1.0, 0.5, 0.0, 1.0, 0.0, 0.0)


def sampler(views_per_step=2, seed=0):
    return SameTimeConfig(views_per_step).build(timed_views(TIMES), seed, 100)


def test_the_views_of_a_step_have_one_time():
    samples = sampler()
    for _ in range(30):
        step = samples.next()
        assert 1 <= len(step) <= 2
        assert len({TIMES[view] for view in step}) == 1


@pytest.mark.parametrize(("views_per_step", "steps"), [(1, 9), (2, 5), (3, 4), (99, 3)])
def test_every_view_comes_once_per_epoch(views_per_step, steps):
    samples = sampler(views_per_step)
    for _ in range(3):
        epoch = [view for _ in range(steps) for view in samples.next()]
        assert sorted(epoch) == list(range(9))


def test_epochs_pair_views_anew():
    samples = sampler()
    epochs = [frozenset(frozenset(samples.next()) for _ in range(5)) for _ in range(6)]
    assert len(set(epochs)) > 1


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (
            (None, None),
            "sampler 'same-time': the views of this capture have no times.\nUse sampler=uniform.",
        ),
        (
            (0.0, 0.5, 1.0),
            "sampler 'same-time': no two of the training views have the same time.\n"
            "Use sampler=uniform: one camera that moves has one view per time.",
        ),
    ],
)
def test_views_that_share_no_time_are_refused(times, message):
    with pytest.raises(ConfigError) as caught:
        SameTimeConfig().build(timed_views(times), 0, 100)
    assert str(caught.value) == message
