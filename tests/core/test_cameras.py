"""Cameras: where they are, and what may share a batch."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera

from gsfw.core.cameras import CameraModel, Cameras, shrunk_to


def three() -> Cameras:
    cameras = Cameras.cat([front_camera(distance=d) for d in (3.0, 4.0, 5.0)])
    return replace(
        cameras, time=torch.tensor([0.0, 0.5, 1.0]), camera_index=torch.tensor([4, 5, 6])
    )


def test_centers_are_where_the_transform_takes_to_the_origin():
    turn = torch.linalg.matrix_exp(torch.tensor([[0, -0.7, 0.2], [0.7, 0, 0.4], [-0.2, -0.4, 0.0]]))
    pose = torch.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, torch.tensor([1.0, -2.0, 3.0])
    cameras = replace(front_camera(), world_to_camera=pose[None])
    moved = pose[:3, :3] @ cameras.centers[0] + pose[:3, 3]
    torch.testing.assert_close(moved, torch.zeros(3), rtol=0, atol=1e-5)


def test_a_camera_in_front_stands_on_the_negative_axis():
    assert front_camera(distance=4.0).centers.tolist() == [[0.0, 0.0, -4.0]]


def test_selecting_keeps_every_field_in_step():
    chosen = three().select([2, 0])
    assert len(chosen) == 2
    assert chosen.centers[:, 2].tolist() == [-5.0, -3.0]
    assert chosen.time is not None
    assert chosen.time.tolist() == [1.0, 0.0]
    assert chosen.camera_index is not None
    assert chosen.camera_index.tolist() == [6, 4]
    assert len(three().select(slice(1, None))) == 2


def test_conversion_leaves_indices_alone():
    cameras = three().to(dtype=torch.float64)
    assert cameras.world_to_camera.dtype == torch.float64
    assert cameras.time is not None
    assert cameras.time.dtype == torch.float64
    assert cameras.camera_index is not None
    assert cameras.camera_index.dtype == torch.int64


def test_resizing_scales_intrinsics_by_the_exact_ratio_of_each_axis():
    cameras = front_camera(40, 30).resized(13, 15)
    assert (cameras.width, cameras.height) == (13, 15)
    expected = [[48 * 13 / 40, 0, 6.5], [0, 24, 7.5], [0, 0, 1]]
    torch.testing.assert_close(cameras.intrinsics[0], torch.tensor(expected))


def test_cameras_of_different_sizes_or_models_cannot_be_joined():
    for other in (front_camera(41, 30), replace(front_camera(), model=CameraModel.FISHEYE)):
        with pytest.raises(ValueError, match="share a batch") as caught:
            Cameras.cat([front_camera(), other])
        assert str(caught.value) == "cameras of different sizes or models cannot share a batch"


def test_cameras_that_differ_in_what_is_known_cannot_be_joined():
    with pytest.raises(ValueError, match="time") as caught:
        Cameras.cat([three(), front_camera()])
    assert str(caught.value) == "some of the cameras have 'time' and some do not"


def test_views_shrink_to_a_longest_side_and_never_grow():
    cameras = front_camera(400, 30)
    small = shrunk_to(cameras, 10)
    assert (small.width, small.height) == (10, 1), "no side vanishes"
    assert torch.equal(small.intrinsics, cameras.resized(10, 1).intrinsics)
    same = shrunk_to(cameras, 500)
    assert (same.width, same.height) == (400, 30)
    assert torch.equal(same.intrinsics, cameras.intrinsics)
