"""Colours as bytes."""

import torch

from gsfw.core.color_bytes import color_bytes


def test_every_level_is_its_own_and_values_between_take_the_nearest():
    levels = torch.arange(256)
    assert torch.equal(color_bytes(levels / 255), levels.byte())
    assert color_bytes(torch.tensor([[-0.1, 1.2], [100.4 / 255, 100.6 / 255]])).tolist() == [
        [0, 255],
        [100, 101],
    ]
