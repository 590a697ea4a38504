"""Uniform sampling."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.scenes import front_camera

from gsfw.core.datamanager import Views
from gsfw.samplers.uniform import UniformSampler


def views(count: int) -> Views:
    return Views(tuple(f"{i}.png" for i in range(count)), (front_camera(),) * count)


@settings(max_examples=20)
@given(st.integers(1, 9), st.integers(1, 5), st.integers(-3, 2**40))
def test_every_view_comes_once_per_epoch(count, views_per_step, seed):
    sampler = UniformSampler(count, views_per_step, seed)
    stream = [view for _ in range(3 * count) for view in sampler.next()]
    for epoch in range(3 * views_per_step):
        assert sorted(stream[epoch * count : (epoch + 1) * count]) == list(range(count))


def test_seeds_and_epochs_have_orders_of_their_own():
    def epochs(seed):
        sampler = UniformSampler(50, 50, seed)
        return [sampler.next() for _ in range(3)]

    assert len({*epochs(0), *epochs(1)}) == 6
    assert epochs(0) == epochs(0)


def test_the_generators_of_torch_are_left_alone():
    before = torch.get_rng_state()
    UniformSampler(50, 2, 0).next()
    assert torch.equal(torch.get_rng_state(), before)
