"""Camera poses."""

import pytest
import torch
from support.small_captures import opengl, ring

from gsfw.core.errors import DataError
from gsfw.datamanagers.poses import (
    pose_from_center,
    pose_from_opencv,
    pose_from_opengl,
    pose_from_quaternion,
)


def matrix(values) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def test_opengl_poses_become_opencv_transforms():
    for pose in ring(5).poses:
        torch.testing.assert_close(
            pose_from_opengl(matrix(opengl(pose)), "a"), torch.from_numpy(pose)
        )


def test_rounded_rotations_are_made_exact_about_the_camera_centre():
    pose = matrix(opengl(ring(origin=(5e6, 5e6, 0.0)).poses[0]))
    rounded = pose.clone()
    rounded[:3, :3] = (pose[:3, :3] * 1e4).round() / 1e4
    loaded = pose_from_opengl(rounded, "a")
    rotation = loaded[:3, :3]
    torch.testing.assert_close(rotation @ rotation.T, torch.eye(3).double())
    center = -rotation.T @ loaded[:3, 3]
    assert float((center - pose[:3, 3]).abs().max()) < 1e-7


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_pose_that_is_not_finite_names_its_frame(value):
    pose = matrix(opengl(ring().poses[0]))
    pose[1, 3] = value
    with pytest.raises(DataError) as error:
        pose_from_opengl(pose, "transforms.json: frame a.png")
    assert str(error.value) == (
        "transforms.json: frame a.png: the pose (transform_matrix) has numbers that are not "
        "finite.\nRemove this frame, or compute its pose again."
    )


def test_a_scaled_pose_is_refused_with_the_reason():
    pose = matrix(opengl(ring().poses[0]))
    pose[:3, :3] *= 2
    with pytest.raises(DataError, match=r"frame a\.png: .* not rigid: .*off by 3, determinant 8"):
        pose_from_opengl(pose, "frame a.png")


def test_a_mirrored_pose_is_refused():
    pose = matrix(opengl(ring().poses[0]))
    pose[:3, 0] *= -1
    with pytest.raises(DataError, match="determinant -1"):
        pose_from_opengl(pose, "frame a.png")


@pytest.mark.parametrize(
    ("quaternion", "translation"),
    [
        ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((float("nan"), 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((1.0, 0.0, 0.0, 0.0), (0.0, float("inf"), 0.0)),
    ],
)
def test_a_quaternion_pose_that_is_none_names_its_image(quaternion, translation):
    with pytest.raises(DataError, match=r"a\.png: the pose is not finite or not rigid"):
        pose_from_quaternion(quaternion, translation, "a.png")


def test_opencv_poses_are_kept_and_made_exact():
    for pose in map(torch.from_numpy, ring(5).poses):
        torch.testing.assert_close(pose_from_opencv(pose, "a"), pose)
        torch.testing.assert_close(pose_from_opencv(pose[:3] + 1e-5, "a")[:3, :3].det().item(), 1.0)


def test_a_rotation_and_a_centre_make_a_pose():
    for pose in map(torch.from_numpy, ring(5).poses):
        center = -pose[:3, :3].T @ pose[:3, 3]
        torch.testing.assert_close(pose_from_center(pose[:3, :3], center, "a"), pose)


def test_an_opencv_pose_that_is_none_is_refused():
    pose = torch.from_numpy(ring().poses[0])
    with pytest.raises(DataError, match=r"camera a: the pose is not rigid: .*\nExpected world-to-"):
        pose_from_opencv(2 * pose, "camera a")
    with pytest.raises(DataError, match=r"camera a: the pose has numbers that are not finite"):
        pose_from_opencv(pose * float("nan"), "camera a")
