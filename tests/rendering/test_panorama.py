"""Panoramas and stereo: what is seen in which direction."""

import math
from dataclasses import replace

import pytest
import torch
from support.moving_scene import WHITE, camera_at, two_balls

from gsfw.core.maths.camera_path import look_at
from gsfw.core.maths.rays import pixel_rays
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.rendering.channels import CHANNELS, render_channels
from gsfw.rendering.panorama import panorama_images, panorama_width
from gsfw.rendering.shot import Shot
from gsfw.rendering.stereo import eye_distance, stereo_images

COLOR, DEPTH, NORMALS = (CHANNELS[name] for name in ("color", "depth", "normals"))
UP = torch.tensor([0.0, -1.0, 0.0])


def inside_a_ball(camera):
    """Directions as colours, and a ball of radius 2 around the camera: depth and normals."""
    directions = pixel_rays(camera)[0, ..., 3:]
    local = directions @ camera.world_to_camera[0, :3, :3].T
    flip = torch.tensor([1.0, -1.0, -1.0])
    return [0.5 + 0.5 * directions, 2 * local[..., 2], 0.5 - 0.5 * local * flip]


def direction(image, row, column):
    return 2 * image[row, column] - 1


def test_every_direction_is_where_it_belongs():
    camera = camera_at(None)
    color, depth, normals = panorama_images(inside_a_ball, (COLOR, DEPTH, NORMALS), camera, 128, UP)
    assert color.shape == (64, 128, 3)
    longitude = ((torch.arange(128) + 0.5) / 128 - 0.5) * 2 * math.pi
    latitude = (0.5 - (torch.arange(64) + 0.5) / 64)[:, None] * math.pi
    expected = torch.stack(
        [
            latitude.cos() * longitude.sin(),
            -latitude.sin().expand(64, 128),
            latitude.cos() * longitude.cos(),
        ],
        dim=2,
    )
    assert torch.allclose(2 * color - 1, expected, atol=0.01)
    assert torch.allclose(depth, torch.full((64, 128), 2.0), atol=0.01)
    shown = expected * torch.tensor([-1.0, 1.0, 1.0])
    assert torch.allclose(2 * normals - 1, shown, atol=0.02)


def test_the_horizon_is_level_and_the_heading_stays():
    pose = look_at(torch.tensor([[0.0, -2.0, -3.0]]), torch.zeros(3), UP)
    camera = replace(camera_at(None), world_to_camera=pose)
    (color,) = panorama_images(lambda face: inside_a_ball(face)[:1], (COLOR,), camera, 128, UP)
    ahead = direction(color, 32, 64)
    assert ahead.tolist() == pytest.approx([0, 0, 1], abs=0.05)
    assert float(direction(color, 0, 0)[1]) == pytest.approx(-1, abs=0.01)


def test_the_middle_shows_what_the_camera_sees():
    model, rasterizer, camera = two_balls(), ReferenceRasterizer(), camera_at(0.5)

    noon = torch.tensor(0.5)

    def shoot(view):
        return render_channels((COLOR, DEPTH), Shot(model, rasterizer, view, WHITE, noon))

    width = panorama_width(camera)
    assert width == 2 * round(math.pi * float(camera.intrinsics[0, 0, 0]))
    color, depth = panorama_images(shoot, (COLOR, DEPTH), camera, width, UP)
    seen, far = shoot(camera)
    middle = color[width // 4 - 2 : width // 4 + 2, width // 2 - 2 : width // 2 + 2]
    assert float((middle.mean((0, 1)) - seen[10:14, 14:18].mean((0, 1))).abs().max()) < 0.05
    assert float(depth.nan_to_num(0).max()) == pytest.approx(float(far.nan_to_num(0).max()), 0.1)
    assert bool(depth.isnan().any())


def test_the_left_eye_is_at_the_left():
    camera, eyes = camera_at(None), []

    def shoot(view):
        eyes.append(view.centers[0])
        return [torch.full((24, 32, 3), len(eyes) / 2)]

    (both,) = stereo_images(shoot, camera, 0.2)
    assert both.shape == (24, 64, 3)
    assert float(both[0, 0, 0]) < float(both[0, 63, 0])
    across = camera.world_to_camera[0, 0, :3]
    assert float((eyes[1] - eyes[0]) @ across) == pytest.approx(0.2, abs=1e-6)


def test_the_eyes_are_apart_by_a_part_of_the_distance():
    camera = camera_at(None)
    distance = float(camera.centers[0].norm())
    found = eye_distance(camera, torch.zeros(3, dtype=torch.float64))
    assert found == pytest.approx(distance / 30, rel=1e-5)
