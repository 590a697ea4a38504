"""Orbits go around what the cameras look at."""

import pytest
import torch
from support.scenes import front_camera

from gsfw.core.cameras import Cameras
from gsfw.core.maths.camera_path import (
    at_times,
    gathered,
    look_at,
    orbit,
    spiral,
    up_direction,
    viewing_center,
)


def ring(target: torch.Tensor, count: int = 8) -> Cameras:
    """Cameras around a target, 1 above it and 2 away."""
    angles = torch.arange(count, dtype=torch.float64) * 2 * torch.pi / count
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    around = torch.stack([2 * angles.cos(), 2 * angles.sin(), torch.ones(count).double()], dim=1)
    one = front_camera(dtype=torch.float64)
    poses = look_at(target + around, target, up)
    return Cameras(poses, one.intrinsics.expand(count, 3, 3), one.width, one.height)


def test_look_at_puts_the_target_on_the_axis_and_up_upwards():
    target = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    pose = look_at(torch.zeros(1, 3).double(), target, torch.tensor([0.0, 0.0, 1.0]).double())[0]
    seen = pose[:3, :3] @ target + pose[:3, 3]
    torch.testing.assert_close(seen, torch.tensor([0.0, 0.0, 14.0**0.5]).double())
    assert float(pose[1, 2]) < 0  # World up is towards smaller y in the image.
    assert float(torch.linalg.det(pose[:3, :3])) == pytest.approx(1.0)


def test_looking_at_itself_is_refused():
    with pytest.raises(ValueError, match="cannot look at its own position"):
        look_at(torch.zeros(1, 3), torch.zeros(3), torch.tensor([0.0, 0.0, 1.0]))


def test_the_center_is_where_the_axes_meet():
    target = torch.tensor([0.5, -1.0, 2.0], dtype=torch.float64)
    torch.testing.assert_close(viewing_center(ring(target)), target)


def test_parallel_axes_still_have_a_center():
    center = viewing_center(front_camera(dtype=torch.float64))
    torch.testing.assert_close(center, torch.tensor([0.0, 0.0, -3.0], dtype=torch.float64))


def test_an_orbit_keeps_height_and_distance_and_looks_inwards():
    target = torch.tensor([0.5, -1.0, 2.0], dtype=torch.float64)
    cameras = ring(target)
    path = orbit(cameras, 12)
    assert len(path) == 12
    offsets = path.centers - target
    torch.testing.assert_close(offsets[:, 2], torch.ones(12).double())
    torch.testing.assert_close(offsets[:, :2].norm(dim=1), torch.full((12,), 2.0).double())
    torch.testing.assert_close(viewing_center(path), target)
    torch.testing.assert_close(up_direction(path), torch.tensor([0.0, 0.0, 1.0]).double())


def test_an_orbit_goes_no_further_than_the_cameras_stood():
    target = torch.zeros(3, dtype=torch.float64)
    half = ring(target).select([0, 1, 2])  # At 0, 45 and 90 degrees; their mean up leans a little.
    path = orbit(half, 16)
    angles = torch.rad2deg(torch.atan2(path.centers[:, 1], path.centers[:, 0]))
    assert float(angles.min()) == pytest.approx(0.0, abs=5.0)
    assert float(angles.max()) == pytest.approx(90.0, abs=5.0)
    assert float((angles.roll(-1) - angles).abs().max()) < 25


def test_a_spiral_goes_from_the_lowest_cameras_to_the_highest_and_back():
    low, high = ring(torch.tensor([0.0, 0.0, -0.5]).double()), ring(torch.zeros(3).double())
    path = spiral(Cameras.cat([low, high]), 16)
    target = viewing_center(Cameras.cat([low, high]))
    heights = (path.centers - target)[:, 2]
    assert float(heights[8] - heights[0]) == pytest.approx(0.5, abs=0.05)
    assert float((heights.roll(-1) - heights).abs().max()) < 0.15
    torch.testing.assert_close(viewing_center(path), target, atol=1e-6, rtol=0)


def test_a_spiral_before_a_scene_stays_near_the_cameras():
    offsets = torch.tensor([[x, y, 0.0] for x in (-1, 0, 1) for y in (-0.5, 0, 0.5)]).double()
    target = torch.tensor([0.0, 0.0, 6.0]).double()
    one = front_camera(dtype=torch.float64)
    poses = look_at(offsets, target, torch.tensor([0.0, -1.0, 0.0]).double())
    cameras = Cameras(poses, one.intrinsics.expand(9, 3, 3), one.width, one.height)
    path = spiral(cameras, 24)
    assert bool((path.centers.abs().amax(0) <= torch.tensor([1.01, 0.51, 0.5])).all())
    assert float(path.centers[:, 0].max() - path.centers[:, 0].min()) > 1.5
    torch.testing.assert_close(viewing_center(path), viewing_center(cameras))


def test_a_single_camera_has_an_orbit_that_stays_where_it_is():
    path = orbit(front_camera(dtype=torch.float64), 4)
    torch.testing.assert_close(path.centers, path.centers[:1].expand(4, 3))


def test_a_single_camera_stands_still_while_time_passes():
    cameras = at_times(front_camera(), [0.0, 0.25, 1.0])
    assert cameras.time.tolist() == [0.0, 0.25, 1.0]
    assert cameras.time.dtype == cameras.world_to_camera.dtype
    assert len(cameras.world_to_camera.unique(dim=0)) == 1


def test_each_camera_of_a_path_gets_its_own_time():
    path = orbit(ring(torch.zeros(3, dtype=torch.float64)), 3)
    cameras = at_times(path, [0.0, 0.5, 1.0])
    assert cameras.time.tolist() == [0.0, 0.5, 1.0]
    assert torch.equal(cameras.world_to_camera, path.world_to_camera)


def test_gathered_cameras_have_all_poses_and_the_lens_of_the_first():
    around = ring(torch.zeros(3, dtype=torch.float64), 3)
    apart = [around.select([index]) for index in range(3)]
    apart[1] = at_times(apart[1].resized(7, 5), [0.5])
    together = gathered(apart)
    assert torch.equal(together.world_to_camera, around.world_to_camera)
    assert torch.equal(together.intrinsics, around.intrinsics)
    assert (together.width, together.height) == (around.width, around.height)
    assert together.time is None
