"""Values of each Gaussian."""

from dataclasses import replace

import pytest
import torch
from support.moving_scene import DriftingGaussians, camera_at, two_balls

from gsfw.core.splats import Sh
from gsfw.rendering.gaussian_values import degrees, speeds, view_depths


def test_the_degree_is_that_of_each_gaussian_and_at_most_the_active_one():
    splats = two_balls().splats()
    coefficients = torch.zeros(len(splats), 16, 3)
    dense = replace(splats, colors=Sh(coefficients, 3))
    assert degrees(dense).tolist() == [3.0] * len(splats)
    own = torch.arange(len(splats)) % 4
    ragged = replace(splats, colors=Sh(coefficients, 3).of_degrees(own))
    assert torch.equal(degrees(ragged), own.float())
    lower = replace(ragged, colors=replace(ragged.colors, degree=1))
    assert torch.equal(degrees(lower), own.float().clamp(max=1))
    plain = replace(splats, colors=torch.zeros(len(splats), 3))
    assert degrees(plain).tolist() == [0.0] * len(splats)


def test_depths_are_along_the_axis_of_the_camera():
    splats, camera = two_balls().splats(), camera_at(None)
    pose = camera.world_to_camera[0]
    expected = (splats.means @ pose[:3, :3].T + pose[:3, 3])[:, 2]
    assert torch.allclose(view_depths(splats, camera), expected)


class Blinking(DriftingGaussians):
    """Row 0 is there from 0.5 on only."""

    def splats(self, time=None, cameras=None):
        splats = super().splats(time, cameras)
        kept = torch.arange(0 if float(time) >= 0.5 else 1, len(splats))
        return replace(splats.take(kept), rows=kept)


@pytest.mark.parametrize("time", [0.0, 0.5, 0.502, 1.0])
def test_the_speed_of_a_gaussian_that_comes_and_goes_is_known_while_it_is_there(time):
    model = two_balls(velocity=0.8)
    model.__class__ = Blinking
    moment = torch.tensor(time)
    splats = model.splats(moment)
    assert splats.rows is not None
    found = speeds(model, splats, moment)
    expected = model.velocities.values.detach().norm(dim=1)[splats.rows]
    assert found.shape == (len(splats),)
    assert torch.allclose(found, expected, rtol=1e-3)
