"""Cameras: poses, intrinsics and times of images."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor


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
