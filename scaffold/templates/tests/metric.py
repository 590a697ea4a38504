"""Tests of metric my-part."""

import torch
from gsfw.testing import conformance

from my_part.metric import MyPart

test_conforms = conformance("metric", "my-part")


def test_only_valid_pixels_count():
    black, white = torch.zeros(2, 2, 3), torch.ones(2, 2, 3)
    valid = torch.tensor([[[True], [False]], [[False], [False]]])
    target = torch.where(valid, black, white)
    metric = MyPart()
    assert metric(black, target, None) == 0.75
    assert metric(black, target, valid) == 0.0
