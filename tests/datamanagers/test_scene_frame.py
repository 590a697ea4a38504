"""The scene frame."""

import pytest
import torch
from support.small_captures import ring

from gsfw.core.errors import DataError
from gsfw.datamanagers.scene_frame import camera_centers, scene_frame


def poses_of(capture) -> torch.Tensor:
    return torch.stack([torch.from_numpy(pose) for pose in capture.poses])


def one_place(views: int = 3) -> torch.Tensor:
    """Cameras that all stand at (1, 2, 3), turned about the vertical axis."""
    poses = torch.eye(4, dtype=torch.float64).repeat(views, 1, 1)
    for view in range(views):
        angle = torch.tensor(0.7 * view, dtype=torch.float64)
        poses[view, 0, 0] = poses[view, 2, 2] = angle.cos()
        poses[view, 0, 2], poses[view, 2, 0] = angle.sin(), -angle.sin()
        poses[view, :3, 3] = -poses[view, :3, :3] @ torch.tensor([1.0, 2.0, 3.0]).double()
    return poses


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_cameras_lie_around_the_origin_at_extent_1_whatever_their_size(size):
    capture = ring(5, size)
    scene_from_world, extent = scene_frame(poses_of(capture), torch.from_numpy(capture.points))
    centers = camera_centers(scene_from_world.camera(poses_of(capture)))
    torch.testing.assert_close(centers.mean(0), torch.zeros(3).double(), atol=1e-12, rtol=0)
    assert 1.1 * float(centers.norm(dim=1).max()) == pytest.approx(1.0)
    assert extent == 1.0


def test_the_frame_is_never_rotated():
    scene_from_world, _ = scene_frame(poses_of(ring()), torch.zeros(0, 3).double())
    assert torch.equal(scene_from_world.rotation, torch.eye(3).double())


def test_georeferenced_coordinates_keep_a_tenth_of_a_millimetre_through_float32():
    capture = ring(6, 30.0, origin=(5e6, 4.9e6, 300.0))
    points = torch.from_numpy(capture.points)
    scene_from_world, _ = scene_frame(poses_of(capture), points)
    stored = scene_from_world.apply(points).float()
    back = scene_from_world.inverse().apply(stored)
    assert float((back - points).abs().max()) < 1e-4


def test_cameras_at_one_place_take_their_size_from_the_points():
    points = torch.tensor([[1.0, 2.0, 8.0], [1.0, 2.0, -2.0], [6.0, 2.0, 3.0]]).double()
    scene_from_world, extent = scene_frame(one_place(), points)
    assert scene_from_world.scale == pytest.approx(1 / 5)
    assert extent == 1.0


@pytest.mark.parametrize("views", [1, 3])
def test_without_points_cameras_at_one_place_keep_the_scale_of_the_data(views):
    scene_from_world, extent = scene_frame(one_place(views), torch.zeros(0, 3).double())
    assert (scene_from_world.scale, extent) == (1.0, 1.0)
    torch.testing.assert_close(
        scene_from_world.apply(torch.tensor([1.0, 2.0, 3.0])), torch.zeros(3).double()
    )


@pytest.mark.parametrize("far", [1e16, 1e174, 1.7e308])
def test_held_out_cameras_beyond_computing_are_refused(far):
    held_out = one_place().clone()
    held_out[0, :3, 3] = torch.tensor([far, -far, far], dtype=torch.float64)
    held_out[0, 0, 1], held_out[0, 1, 0] = 1.0, 1.0
    with pytest.raises(DataError, match=r"coordinates of cameras or points reach"):
        scene_frame(one_place(), torch.zeros(0, 3).double(), held_out)


def test_coordinates_beyond_computing_are_refused():
    with pytest.raises(DataError) as error:
        scene_frame(one_place(), torch.tensor([[0.0, 1e300, 0.0]], dtype=torch.float64))
    assert str(error.value) == (
        "coordinates of cameras or points reach 1e+300; expected at most 1e+15.\n"
        "The file may be damaged; if not, scale its coordinates down."
    )
