"""Views with a large loss more often."""

import io
from collections import Counter

import pytest
import torch
from support.timed_views import timed_views

from gsfw.samplers.error_weighted import ErrorWeightedConfig

LOSSES = (0.1, 0.2, 0.3, 0.4, 1.0)


def sampler(uniform_share=0.3, memory=0.7, views_per_step=1, seed=0, views=5):
    config = ErrorWeightedConfig(uniform_share, memory, views_per_step)
    return config.build(timed_views([None] * views), seed, 1000)


def train(samples, steps, losses=LOSSES):
    """What is drawn when every view keeps its loss."""
    drawn = []
    for _ in range(steps):
        views = samples.next()
        samples.observe(views, torch.tensor([losses[view] for view in views]))
        drawn += views
    return drawn


def test_the_first_epoch_has_every_view_once():
    for seed in range(10):
        assert sorted(train(sampler(seed=seed), 5)) == [0, 1, 2, 3, 4]


@pytest.mark.slow
@pytest.mark.parametrize(
    "uniform_share", [0.3, *(pytest.param(share, marks=pytest.mark.slow) for share in (0.0, 1.0))]
)
def test_views_come_in_proportion_to_their_loss(uniform_share):
    samples = sampler(uniform_share)
    train(samples, 5)
    epochs = 2000
    counts = Counter(train(samples, 5 * epochs))
    for view, loss in enumerate(LOSSES):
        share = uniform_share / 5 + (1 - uniform_share) * loss / sum(LOSSES)
        # An epoch's count is floor or ceil of what is due: its variance is at most 1/4.
        assert abs(counts[view] - share * 5 * epochs) <= 4 * (epochs / 4) ** 0.5


def test_a_view_comes_as_often_per_epoch_as_it_is_due_give_or_take_less_than_one():
    samples = sampler(uniform_share=0.0)
    train(samples, 5)
    for _ in range(200):
        counts = Counter(train(samples, 5))
        for view, loss in enumerate(LOSSES):
            assert abs(counts[view] - 5 * loss / sum(LOSSES)) < 1


@pytest.mark.slow
def test_no_view_starves():
    samples = sampler(uniform_share=0.3)
    train(samples, 5)
    counts = Counter(train(samples, 5 * 400, losses=(1e-9, 1.0, 1.0, 1.0, 1.0)))
    assert abs(counts[0] - 0.3 * 400) <= 4 * (400 / 4) ** 0.5


def test_equal_losses_give_every_view_once_per_epoch():
    samples = sampler()
    for _ in range(50):
        assert sorted(train(samples, 5, losses=[0.37] * 5)) == [0, 1, 2, 3, 4]


def test_the_mean_of_a_loss_runs_and_starts_with_the_first_one():
    samples = sampler(memory=0.75, views=2)
    for loss in (0.8, 0.4, 0.4):
        samples.observe((1,), torch.tensor([loss]))
    expected = (0.8 * 0.75 + 0.4 * 0.25) * 0.75 + 0.4 * 0.25
    torch.testing.assert_close(samples.state_dict()["losses"], torch.tensor([0.0, expected]))


def test_a_step_that_was_not_finite_is_not_noted():
    samples = sampler(views=2)
    samples.observe((0, 1), torch.tensor([0.5, 0.25]))
    samples.observe((0,), torch.tensor([0.0]))
    assert samples.state_dict()["losses"].tolist() == [0.5, 0.25]


def test_looking_ahead_is_exact_within_the_epoch_and_a_hint_beyond_and_changes_nothing():
    samples = sampler(views_per_step=2, views=7)
    losses = [0.1 * view + 0.1 for view in range(7)]
    train(samples, 6, losses)
    for steps_left in (2, 1):
        before = pickled(samples)
        ahead = samples.peek(30)
        assert len(ahead) == 30
        assert pickled(samples) == before
        following = [view for step in range(steps_left) for view in peeked(samples, step)]
        assert list(ahead[: 2 * steps_left]) == following
        train(samples, 1, losses)


def peeked(samples, step):
    """What a copy of the sampler draws after some further steps."""
    other = sampler(views_per_step=2, views=7)
    other.load_state_dict(samples.state_dict())
    return [other.next() for _ in range(step + 1)][-1]


def pickled(samples) -> bytes:
    file = io.BytesIO()
    torch.save(samples.state_dict(), file)
    return file.getvalue()


@pytest.mark.parametrize("steps", [0, 3, 10, 13])
def test_a_restored_sampler_continues_in_the_middle_of_an_epoch(steps):
    samples = sampler(seed=3)
    train(samples, steps)
    file = io.BytesIO(pickled(samples))
    other = sampler(seed=3)
    other.load_state_dict(torch.load(file, weights_only=True))
    assert train(other, 40) == train(samples, 40)


def test_what_was_restored_is_a_copy():
    samples, other = sampler(), sampler()
    train(samples, 7)
    other.load_state_dict(samples.state_dict())
    state = pickled(samples)
    train(other, 20)
    assert pickled(samples) == state
