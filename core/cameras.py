"""Cameras: poses, intrinsics and times of images."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

RIGID = 0.01
"""Largest error of the products of a rotation's rows; a scale of 1.005 has it."""


class CameraModel(Enum):
    """Projection model: maps directions to pixels."""

    PINHOLE = "pinhole"
    """Pixels are fx x / z + cx, fy y / z + cy."""
    ORTHOGRAPHIC = "orthographic"
    """Pixels are fx x + cx, fy y + cy."""
    FISHEYE = "fisheye"
    """Equidistant: the distance from (cx, cy) is the focal length times the angle to the axis."""


@dataclass(frozen=True)
class Cameras:
    """``c`` cameras of one image size and one model.

    Lenses have no distortion: data managers undistort images. Axes are OpenCV's (x right, y down,
    z forward). The centre of the first pixel is at (0.5, 0.5).
    """

    world_to_camera: Float[Tensor, "c 4 4"]
    """Rigid transforms from scene to camera; may require grad (pose refinement)."""
    intrinsics: Float[Tensor, "c 3 3"]
    """[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels; in pixels per scene unit if orthographic."""
    width: int
    """Pixels."""
    height: int
    """Pixels."""
    model: CameraModel = CameraModel.PINHOLE
    time: Float[Tensor, " c"] | None = None
    """Capture time in [0, 1] over the whole data set; ``None`` for a static capture."""
    camera_index: Int[Tensor, " c"] | None = None
    """Number of the physical camera of each image; ``None`` when unknown."""

    @staticmethod
    def from_matrices(
        world_to_camera: object,
        intrinsics: object,
        width: int,
        height: int,
        *,
        model: CameraModel = CameraModel.PINHOLE,
        time: object = None,
    ) -> Cameras:
        """Make cameras from matrices of any kind: tensors, NumPy arrays or lists.

        Axes are OpenCV's: x right, y down, z forward. For camera-to-world matrices of OpenGL or
        Blender (y up, z backward): ``diag([1, -1, -1, 1]) @ inv(camera_to_world)``.

        Args:
            world_to_camera: rigid transforms, [c, 4, 4] or [c, 3, 4]; without c for one camera.
            intrinsics: [c, 3, 3] in pixels, or [3, 3] for all of them.
            width: of the images, in pixels.
            height: of the images, in pixels.
            model: projection model.
            time: capture times in [0, 1], [c] or one number; ``None`` for a static scene.

        Raises:
            ValueError: a shape is wrong, or a transform is not rigid; names it.
        """
        poses = torch.as_tensor(world_to_camera)
        poses = poses if poses.is_floating_point() else poses.float()
        poses = poses[None] if poses.dim() == 2 else poses
        lenses = torch.as_tensor(intrinsics).to(poses)
        if poses.dim() != 3 or poses.shape[1:] not in ((4, 4), (3, 4)):
            raise ValueError(
                f"world_to_camera: expected shape [c, 4, 4] or [c, 3, 4], found {[*poses.shape]}"
            )
        if poses.shape[1] == 3:
            last = poses.new_tensor([0.0, 0.0, 0.0, 1.0]).expand(len(poses), 1, 4)
            poses = torch.cat([poses, last], dim=1)
        if lenses.shape not in ((3, 3), (1, 3, 3), (len(poses), 3, 3)):
            raise ValueError(
                f"intrinsics: expected shape [3, 3] or [{len(poses)}, 3, 3], "
                f"found {[*lenses.shape]}"
            )
        _check_rigid(poses)
        times = None if time is None else torch.as_tensor(time).to(poses).expand(len(poses))
        return Cameras(poses, lenses.expand(len(poses), 3, 3), width, height, model, times)

    @staticmethod
    def look_at(
        positions: object,
        target: Sequence[float | int] | Float[Tensor, " 3"] = (0.0, 0.0, 0.0),
        *,
        width: int,
        height: int,
        up: Sequence[float | int] | Float[Tensor, " 3"] = (0.0, -1.0, 0.0),
        field_of_view: float = 50.0,
    ) -> Cameras:
        """Make pinhole cameras that look at a point.

        Args:
            positions: [3] for one camera, or [c, 3]; a tensor, NumPy array or list.
            target: the point, in the middle of the images.
            width: of the images, in pixels.
            height: of the images, in pixels.
            up: upward direction; worlds of COLMAP and OpenCV have y downward.
            field_of_view: angle from left to right, in degrees.

        Raises:
            ValueError: a camera is at the target, or looks along ``up``; or the angle is not
                between 0 and 180.
        """
        from gsfw.core.maths.camera_path import look_at  # It imports this module.

        if not 0 < field_of_view < 180:
            raise ValueError(f"field_of_view: expected 0 to 180 degrees, found {field_of_view:g}")
        places = torch.as_tensor(positions)
        places = (places if places.is_floating_point() else places.float()).reshape(-1, 3)
        poses = look_at(places, torch.as_tensor(target).to(places), torch.as_tensor(up).to(places))
        focal = width / 2 / math.tan(math.radians(field_of_view) / 2)
        lens = [[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]
        return Cameras.from_matrices(poses, lens, width, height)

    def __len__(self) -> int:
        return self.world_to_camera.shape[0]

    @property
    def centers(self) -> Float[Tensor, "c 3"]:
        """Camera positions in scene units."""
        rotation, translation = self.world_to_camera[:, :3, :3], self.world_to_camera[:, :3, 3]
        return -(rotation.transpose(1, 2) @ translation[:, :, None])[:, :, 0]

    def _map(self, function) -> Cameras:  # type: ignore[no-untyped-def]  # noqa: ANN001
        tensors = {
            field.name: function(value)
            for field in fields(self)
            if isinstance(value := getattr(self, field.name), Tensor)
        }
        return replace(self, **tensors)

    def to(
        self, device: torch.device | str | None = None, dtype: torch.dtype | None = None
    ) -> Cameras:
        """The same cameras on another device, or in another floating-point type."""
        return self._map(
            lambda tensor: tensor.to(
                device=device, dtype=dtype if tensor.is_floating_point() else None
            )
        )

    def select(self, indices: list[int] | slice) -> Cameras:
        """Select cameras, in the given order."""
        return self._map(lambda tensor: tensor[indices])

    def resized(self, width: int, height: int) -> Cameras:
        """The same views at another image size; intrinsics follow by the exact ratio per axis."""
        x, y, last = self.intrinsics.unbind(1)
        # Plain numbers: a tensor would need a copy to the GPU, and the host would wait for it.
        scaled = torch.stack([x * (width / self.width), y * (height / self.height), last], dim=1)
        return replace(self, intrinsics=scaled, width=width, height=height)

    @staticmethod
    def cat(parts: list[Cameras]) -> Cameras:
        """Join cameras of one size and model.

        Raises:
            ValueError: the parts differ in size, model, or in which optional fields they have.
        """
        first = parts[0]
        if any(
            (p.width, p.height, p.model) != (first.width, first.height, first.model) for p in parts
        ):
            raise ValueError("cameras of different sizes or models cannot share a batch")
        joined: dict[str, Any] = {}
        for field in fields(first):
            values = [getattr(part, field.name) for part in parts]
            present = [isinstance(value, Tensor) for value in values]
            if all(present):
                joined[field.name] = torch.cat(values)
            elif any(present):
                raise ValueError(f"some of the cameras have {field.name!r} and some do not")
        return replace(first, **joined)


def resized_by(cameras: Cameras, factor: float) -> Cameras:
    """The same views at ``factor`` times their image size, rounded, each side at least a pixel."""
    width, height = (max(1, round(side * factor)) for side in (cameras.width, cameras.height))
    return cameras.resized(width, height)


def shrunk_to(cameras: Cameras, longest: int) -> Cameras:
    """The same views with at most ``longest`` pixels along the longer side of the image."""
    return resized_by(cameras, min(1.0, longest / max(cameras.width, cameras.height)))


def _check_rigid(poses: Float[Tensor, "c 4 4"]) -> None:
    """Check that transforms are rotations and translations.

    ``RIGID`` admits text with three decimals, whose products of rows are wrong by 0.002. Half
    precision rounds more coarsely.

    Raises:
        ValueError: one is not; names the first, and what it does instead.
    """
    found, tolerance = poses.detach().double(), max(RIGID, 16 * torch.finfo(poses.dtype).eps)
    rotations = found[:, :3, :3]
    axes = rotations @ rotations.transpose(1, 2)
    unit = (axes - torch.eye(3).to(axes)).abs().flatten(1).amax(1) <= tolerance
    last = (found[:, 3] - found.new_tensor([0, 0, 0, 1])).abs().amax(1) <= tolerance
    kept = torch.linalg.det(rotations) > 0
    wrong = (~(unit & last & kept)).nonzero()
    if len(wrong) == 0:
        return
    at = int(wrong[0])
    if not found[at].isfinite().all():
        problem = "is not finite"
    elif not last[at]:
        problem = f"has the last row {found[at, 3].tolist()}; transpose it if it is column-major"
    elif not unit[at]:
        lengths = ", ".join(f"{length:.4g}" for length in rotations[at].norm(dim=1).tolist())
        problem = f"scales or shears: the rows of its rotation have the lengths {lengths}"
    else:
        problem = (
            "mirrors. Flip two axes, not one: camera-to-world matrices of OpenGL or Blender become "
            "diag([1, -1, -1, 1]) @ inv(camera_to_world)"
        )
    raise ValueError(f"world_to_camera: expected rigid transforms; matrix {at} {problem}")
