"""Plane sweep: depths of a textured plane, and the points that cameras confirm."""

import pytest
import torch
from torch.nn.functional import interpolate

from gsfw.core.cameras import Cameras
from gsfw.core.maths.plane_sweep import LEAST_SCORE, confirmed_points, plane_sweep

DEPTH = 4.0
WIDTH, HEIGHT, FOCAL = 48, 36, 40.0
WHITE = torch.ones(3)


def cameras_beside_each_other(count: int = 3, step: float = 0.4) -> Cameras:
    poses = torch.eye(4).repeat(count, 1, 1)
    poses[:, 0, 3] = -step * torch.arange(count)
    intrinsics = torch.tensor([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])
    return Cameras(poses, intrinsics.repeat(count, 1, 1), WIDTH, HEIGHT)


def images_of_a_plane(cameras: Cameras) -> torch.Tensor:
    """A smooth random texture at z = DEPTH; each camera's image is shifted by whole pixels."""
    generator = torch.Generator().manual_seed(0)
    coarse = torch.rand(1, 3, 18, 40, generator=generator)
    texture = interpolate(coarse, (HEIGHT, 80), mode="bilinear", align_corners=False)[0]
    shifts = (cameras.centers[:, 0] * FOCAL / DEPTH).round().long().tolist()
    return torch.stack([texture[:, :, s : s + WIDTH].permute(1, 2, 0) for s in shifts])


def test_a_textured_plane_is_found_at_its_depth():
    cameras = cameras_beside_each_other()
    found = plane_sweep(images_of_a_plane(cameras), cameras, 2.0, 10.0, WHITE)
    middle = found.depths[1, 6:-6, 8:-8]
    assert middle.median() == pytest.approx(DEPTH, rel=0.02)
    assert (found.scores[1, 6:-6, 8:-8] > LEAST_SCORE).float().mean() > 0.9


def test_confirmed_points_lie_on_the_plane_and_have_its_colours():
    cameras = cameras_beside_each_other()
    images = images_of_a_plane(cameras)
    found = plane_sweep(images, cameras, 2.0, 10.0, WHITE)
    points, colors = confirmed_points(images, cameras, found)
    assert len(points) > 1000
    assert ((points[:, 2] - DEPTH).abs() < 0.1 * DEPTH).float().mean() > 0.98
    assert colors.shape == points.shape


def test_a_patch_without_texture_takes_the_depth_of_its_surroundings():
    cameras = cameras_beside_each_other()
    images = images_of_a_plane(cameras)
    for image, center in zip(images, cameras.centers, strict=True):
        left = 24 - round(center[0].item() * FOCAL / DEPTH)
        image[12:24, left : left + 12] = 0.4
    found = plane_sweep(images, cameras, 2.0, 10.0, WHITE)
    patch = found.depths[1, 14:22, 22:30]
    assert ((patch - DEPTH).abs() < 0.05 * DEPTH).float().mean() > 0.9


def test_a_point_that_two_cameras_see_through_is_left_out():
    cameras = cameras_beside_each_other(5)
    images = images_of_a_plane(cameras)
    found = plane_sweep(images, cameras, 2.0, 10.0, WHITE)
    kept, _ = confirmed_points(images, cameras, found)
    found.empty[:2] = True
    seen_through, _ = confirmed_points(images, cameras, found)
    assert 0 < len(seen_through) < 0.7 * len(kept)


def test_images_of_the_background_alone_have_no_points():
    cameras = cameras_beside_each_other()
    images = torch.ones(3, HEIGHT, WIDTH, 3)
    points, _ = confirmed_points(images, cameras, plane_sweep(images, cameras, 2.0, 10.0, WHITE))
    assert len(points) == 0
