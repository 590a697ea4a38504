"""Tests of rasterizer my-part."""

import torch
from gsfw.api import Cameras, Splats
from gsfw.testing import conformance

from my_part.rasterizer import MyPart

test_conforms = conformance("rasterizer", "my-part")


def test_a_splat_before_the_camera_is_brightest_at_its_centre():
    intrinsics = torch.tensor([[[20.0, 0.0, 8.5], [0.0, 20.0, 8.5], [0.0, 0.0, 1.0]]])
    cameras = Cameras(torch.eye(4)[None], intrinsics, width=17, height=17)
    means, quats = torch.tensor([[0.0, 0.0, 2.0]]), torch.tensor([[1.0, 0.0, 0.0, 0.0]])
    red = torch.tensor([[1.0, 0.0, 0.0]])
    splats = Splats(means, torch.tensor([0.5]), red, quats, torch.full((1, 3), 0.2))
    output = MyPart().render(splats, cameras)
    assert output.alpha.argmax() == 8 * 17 + 8
    torch.testing.assert_close(output.color[0, 8, 8], torch.tensor([0.5, 0.0, 0.0]))
