"""Tests of method my-part."""

import torch
from gsfw.testing import conformance

from my_part import method

test_conforms = conformance("method", "my-part")


def test_splats_are_spheres_of_the_given_size():
    means, colors = torch.zeros(2, 3), torch.ones(2, 3)
    config = method.MyPartConfig()
    splats = method.MyPartModel(means, colors, 0.5, config).splats()
    torch.testing.assert_close(splats.scales, torch.full((2, 3), 0.5))
    torch.testing.assert_close(splats.opacities, torch.full((2,), 0.5))
