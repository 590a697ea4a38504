"""Camera poses: checks, and conversions to rigid OpenCV world-to-camera transforms in float64."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.maths.rotations import unit_matrices

RIGID = 1e-3
"""Tolerance of R^T R against the identity: files hold rounded numbers."""

MIRRORED = (
    "If the world is left-handed (Unity, Unreal, DirectX), negate one of its axes in all poses and "
    "in all points: for y the second row of each camera-to-world matrix, or the second column of "
    "each world-to-camera rotation. If only the camera's axes are, negate the one that differs "
    "(expected is x right, y up, z back for OpenGL; x right, y down, z forward for OpenCV)."
)
"""Treatment of poses of a left-handed frame."""


def read_rows(entry: JsonFields, name: str) -> Float64[Tensor, "r 4"]:
    """The matrix of a pose in a JSON file, with or without its last row.

    Raises:
        DataError: it is missing, or something else.
    """
    return torch.from_numpy(entry.numbers_of(name, ((3, 4), (4, 4))))


def pose_from_opengl(camera_to_world: Float64[Tensor, "r 4"], where: str) -> Float64[Tensor, "4 4"]:
    """World-to-camera, from a camera-to-world matrix with OpenGL axes (x right, y up, z back).

    The rotation becomes the nearest exact one, as a file's rounding would otherwise move cameras
    that are far from the world's origin.

    Raises:
        DataError: it has numbers that are not finite, or is not rigid; begins with ``where``.
    """
    rotation, center = _pose(
        camera_to_world,
        f"{where}: the pose (transform_matrix)",
        "Expected camera-to-world without scale; scale the positions instead.",
    )
    rotation = (rotation * torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)).T
    return _rigid(rotation, -(rotation @ center))


def pose_from_opencv(world_to_camera: Float64[Tensor, "r 4"], where: str) -> Float64[Tensor, "4 4"]:
    """World-to-camera, from such a matrix with OpenCV axes (x right, y down, z forward).

    It is made exactly rigid, as a file's rounding would otherwise move cameras.

    Raises:
        DataError: it has numbers that are not finite, or is not rigid; begins with ``where``.
    """
    rotation, translation = _pose(
        world_to_camera,
        f"{where}: the pose",
        "Expected world-to-camera without scale; scale the translation instead.",
    )
    return _rigid(rotation, translation)


def pose_from_center(
    rotation: Float64[Tensor, "3 3"], center: Float64[Tensor, " 3"], where: str
) -> Float64[Tensor, "4 4"]:
    """World-to-camera, from its rotation and the camera's position in the world.

    Args:
        rotation: from axes of the world to those of the camera (OpenCV's); that of a
            camera-to-world matrix is its transpose.
        center: position of the camera in the world.
        where: place in the data set, for messages.

    Raises:
        DataError: it has numbers that are not finite, or is not rigid; begins with ``where``.
    """
    placed = torch.cat([rotation, -(rotation @ center)[:, None]], dim=1)
    return pose_from_opencv(placed, where)


def _pose(
    matrix: Float64[Tensor, "r 4"], what: str, advice: str
) -> tuple[Float64[Tensor, "3 3"], Float64[Tensor, " 3"]]:
    """The nearest rotation, and the last column."""
    if not matrix.isfinite().all():
        raise DataError(
            f"{what} has numbers that are not finite.",
            "Remove this frame, or compute its pose again.",
        )
    axes = matrix[:3, :3]
    determinant = float(torch.linalg.det(axes))
    error = float((axes.T @ axes - torch.eye(3, dtype=torch.float64)).abs().max())
    if error <= RIGID and determinant < 0:
        raise DataError(
            f"{what} is mirrored (determinant -1): its world or its camera has left-handed axes.",
            MIRRORED,
        )
    if error > RIGID:
        raise DataError(
            f"{what} is not rigid: its columns are not those of a rotation "
            f"(off by {error:.2g}, determinant {determinant:.3g}).",
            advice,
        )
    left, _, right = torch.linalg.svd(axes)
    return left @ right, matrix[:3, 3]


def pose_from_quaternion(
    wxyz: Sequence[float], translation: Sequence[float], where: str
) -> Float64[Tensor, "4 4"]:
    """World-to-camera, from its rotation (a quaternion of norm about 1) and translation.

    Raises:
        DataError: it has numbers that are not finite, or is no rotation; begins with ``where``.
    """
    norm = math.hypot(*wxyz)
    if not all(map(math.isfinite, translation)) or not abs(norm - 1) < 0.1:
        raise DataError(
            f"{where}: the pose is not finite or not rigid (quaternion {list(wxyz)}, "
            f"translation {list(translation)}).",
            "Remove this image from the model, or compute it again.",
        )
    unit = torch.tensor([[value / norm for value in wxyz]], dtype=torch.float64)
    rotation = unit_matrices(unit)[0]
    return _rigid(rotation, torch.tensor(translation, dtype=torch.float64))


def _rigid(
    rotation: Float64[Tensor, "3 3"], translation: Float64[Tensor, " 3"]
) -> Float64[Tensor, "4 4"]:
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose
