"""Viewpoints: all cameras of a capture, of every split, as arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.datamanager import DataManager, Split

SAME_POSE = 1e-5
"""Poses are told apart beyond this, in extents of the cameras: float32 keeps that much."""


@dataclass(frozen=True)
class Viewpoints:
    """``v`` views, those to train on first, in scene units (the extent of the cameras is 1)."""

    names: tuple[str, ...]
    splits: tuple[Split, ...]
    numbers: tuple[int, ...]
    """Of each view within its split."""
    cameras: tuple[Cameras, ...]
    poses: Float[np.ndarray, "v 4 4"]
    """World to camera, OpenCV axes."""
    intrinsics: Float[np.ndarray, "v 3 3"]
    sizes: Int[np.ndarray, "v 2"]
    """Width and height in pixels."""
    physical: Int[np.ndarray, " v"]
    """Which physical camera took it; all 0 where nobody said."""

    @staticmethod
    def of(data: DataManager) -> Viewpoints:
        """The views of a data set."""
        views = {split: data.views(split) for split in Split}
        cameras = [camera for split in Split for camera in views[split].cameras]
        return Viewpoints(
            names=tuple(name for split in Split for name in views[split].names),
            splits=tuple(split for split in Split for _ in views[split].names),
            numbers=tuple(number for split in Split for number in range(len(views[split]))),
            cameras=tuple(cameras),
            poses=np.stack([camera.world_to_camera[0].double().numpy() for camera in cameras]),
            intrinsics=np.stack([camera.intrinsics[0].double().numpy() for camera in cameras]),
            sizes=np.array([(camera.width, camera.height) for camera in cameras]),
            physical=np.array(
                [0 if c.camera_index is None else int(c.camera_index[0]) for c in cameras]
            ),
        )

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def trained(self) -> Bool[np.ndarray, " v"]:
        """Which views are trained on."""
        return np.array([split is Split.TRAIN for split in self.splits])

    @cached_property
    def centers(self) -> Float[np.ndarray, "v 3"]:
        """Positions of the cameras."""
        return -np.einsum("vji,vj->vi", self.poses[:, :3, :3], self.poses[:, :3, 3])

    @property
    def axes(self) -> Float[np.ndarray, "v 3"]:
        """Unit vectors along which the cameras look."""
        return self.poses[:, 2, :3]

    @cached_property
    def times(self) -> Float[np.ndarray, " v"] | None:
        """When each was taken, in [0, 1]; ``None`` for a static capture."""
        times = [None if camera.time is None else float(camera.time[0]) for camera in self.cameras]
        known = [time for time in times if time is not None]
        return np.array(known) if len(known) == len(times) else None

    @cached_property
    def fields_of_view(self) -> Float[np.ndarray, " v"]:
        """Horizontal angles in degrees; NaN for orthographic cameras."""
        return np.array([_field_of_view(camera) for camera in self.cameras])

    @cached_property
    def places(self) -> Int[np.ndarray, " s"]:
        """One view for each different pose, those that are trained on first, in order."""
        rounded = np.round(self.poses / SAME_POSE).reshape(len(self), 16)
        return np.sort(np.unique(rounded, axis=0, return_index=True)[1])

    @cached_property
    def place_of(self) -> Int[np.ndarray, " v"]:
        """Which of the different poses each view has, as an index into ``places``."""
        rounded = np.round(self.poses / SAME_POSE).reshape(len(self), 16)
        _, first, inverse = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
        return np.argsort(np.argsort(first))[inverse.reshape(-1)]

    @property
    def stand_still(self) -> bool:
        """Whether cameras are where they were before at most other times."""
        return self.times is not None and 2 * len(self.places) <= len(self)

    def named(self, views: Sequence[int]) -> tuple[str, ...]:
        """The names of some views."""
        return tuple(self.names[view] for view in views)

    def project(
        self, view: int, points: Float[np.ndarray, "p 3"]
    ) -> tuple[Float[np.ndarray, "p 2"], Bool[np.ndarray, " p"]]:
        """Pixels of points in a view, and which of the points are in front and in the picture."""
        local = points @ self.poses[view, :3, :3].T + self.poses[view, :3, 3]
        depth = local[:, 2]
        model = self.cameras[view].model
        flat = local[:, :2]
        if model is CameraModel.PINHOLE:
            flat = flat / np.maximum(depth, 1e-9)[:, None]
        elif model is CameraModel.FISHEYE:
            radius = np.maximum(np.linalg.norm(flat, axis=1), 1e-12)
            flat = flat * (np.arctan2(radius, depth) / radius)[:, None]
        pixels = flat @ self.intrinsics[view, :2, :2].T + self.intrinsics[view, :2, 2]
        inside = (pixels >= 0).all(1) & (pixels < self.sizes[view]).all(1) & (depth > 0)
        return pixels, inside


def _field_of_view(camera: Cameras) -> float:
    half = 0.5 * camera.width / float(camera.intrinsics[0, 0, 0])
    if camera.model is CameraModel.ORTHOGRAPHIC:
        return math.nan
    # A fisheye's pixels are at equal angles, not at equal distances on a plane.
    return math.degrees(2 * (half if camera.model is CameraModel.FISHEYE else math.atan(half)))
