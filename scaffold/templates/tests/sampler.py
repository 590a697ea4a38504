"""Tests of sampler my-part."""

import torch
from gsfw.testing import conformance

from my_part.sampler import MyPart

test_conforms = conformance("sampler", "my-part")


def test_views_with_a_large_loss_come_more_often():
    sampler = MyPart(num_views=4, seed=1, random_share=0.2)
    sampler.observe((0, 1, 2, 3), torch.tensor([0.1, 0.1, 0.1, 0.9]))
    views = [sampler.next()[0] for _ in range(104)][4:]
    assert views.count(3) > 50
