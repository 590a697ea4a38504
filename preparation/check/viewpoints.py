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
from gsfw.core.maths.focus import OBJECT_SIZE, focus
from gsfw.core.scene import Scene
from gsfw.datamanagers.view_spread import numbered_places

SAME_POSE = 1e-5
"""Poses are told apart beyond this, in extents of the cameras: float32 keeps that much."""
POINTS = 2000
"""Number of points that are projected into every place, spread evenly over all."""
ANGLE_POINTS, ANGLE_PLACES = 300, 200
"""Points and places, at most, that angles are computed for: each point takes all pairs."""
OVERLAP = 0.2
"""Views are neighbours if they share this part of what one of them sees: with less, hardly any
part of an image is constrained by the other."""


@dataclass(frozen=True)
class Viewpoints:
    """``v`` views, those to train on first, in scene units (the extent of the cameras is 1)."""

    names: tuple[str, ...]
    splits: tuple[Split, ...]
    numbers: tuple[int, ...]
    """Index of each view within its split."""
    cameras: tuple[Cameras, ...]
    poses: Float[np.ndarray, "v 4 4"]
    """World to camera, OpenCV axes."""
    intrinsics: Float[np.ndarray, "v 3 3"]
    sizes: Int[np.ndarray, "v 2"]
    """Width and height in pixels."""
    physical: Int[np.ndarray, " v"]
    """Number of the physical camera; all 0 if unknown."""

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
        """True for views that are trained on."""
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
        """Time of each, in [0, 1]; ``None`` for a static capture."""
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
        """The pose of each view, as an index into ``places``."""
        rounded = np.round(self.poses / SAME_POSE).reshape(len(self), 16)
        _, first, inverse = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
        return np.argsort(np.argsort(first))[inverse.reshape(-1)]

    @cached_property
    def spots(self) -> Int[np.ndarray, " s"]:
        """The number of the centre of each of ``places``: the views of a panorama have one."""
        return numbered_places(self.centers[self.places], SAME_POSE)

    @property
    def stand_still(self) -> bool:
        """True if cameras are where they were before at most other times."""
        return self.times is not None and 2 * len(self.places) <= len(self)

    def named(self, views: Sequence[int]) -> tuple[str, ...]:
        """The names of some views."""
        return tuple(self.names[view] for view in views)

    def project(
        self, view: int, points: Float[np.ndarray, "p 3"]
    ) -> tuple[Float[np.ndarray, "p 2"], Bool[np.ndarray, " p"]]:
        """Pixels of points in a view, and which of the points are in front and in the image."""
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


@dataclass(frozen=True)
class Surface:
    """Points that are seen, and by which places (different poses) of the cameras."""

    points: Float[np.ndarray, "p 3"]
    rows: Int[np.ndarray, " p"]
    """Their numbers among the points of the scene; -1 for stand-ins."""
    measured: bool
    """False: there are no points, and these stand in for them around where all cameras look."""
    seen: Bool[np.ndarray, "s p"]
    """True for those that are in the image of each place."""

    @staticmethod
    def of(scene: Scene, viewpoints: Viewpoints) -> Surface | None:
        """The surface; ``None`` without points and without a point that all cameras look at."""
        points = scene.points.double().numpy()
        finite = np.flatnonzero(np.isfinite(points).all(1))
        rows = finite[np.linspace(0, len(finite) - 1, min(POINTS, len(finite))).astype(int)]
        measured = len(rows) > 0
        if measured:
            points = points[rows]
        else:
            around = focus(scene)
            if around is None:
                return None
            offsets = np.random.default_rng(0).uniform(-1, 1, (ANGLE_POINTS, 3))
            points = around[0].double().numpy() + OBJECT_SIZE * around[1] * offsets
            rows = np.full(len(points), -1)
        seen = np.stack(
            [viewpoints.project(place, points)[1] for place in viewpoints.places.tolist()]
        )
        return Surface(points, rows, measured, seen)

    def seen_from(self, spots: Int[np.ndarray, " s"]) -> Bool[np.ndarray, "n p"]:
        """True for points that any place of each spot sees; see ``Viewpoints.spots``."""
        seen = np.zeros((spots.max(initial=-1) + 1, self.seen.shape[1]), bool)
        np.logical_or.at(seen, spots, self.seen)
        return seen


@dataclass(frozen=True)
class Angles:
    """Angles, in degrees, at which views see the same points."""

    nearest: Float[np.ndarray, " s"]
    """Angle from each place to the nearest trained place that shows the same; NaN without one."""
    widest: float
    """Median over points of the largest angle between trained places that see it; 0 without."""
    places: tuple[int, ...]
    """Views that the rows of ``nearest`` are."""

    @staticmethod
    def of(surface: Surface, viewpoints: Viewpoints) -> Angles:
        """Measure the angles between all places, or ``ANGLE_PLACES`` of them, spread evenly."""
        count = len(viewpoints.places)
        chosen = np.unique(np.linspace(0, count - 1, min(count, ANGLE_PLACES)).astype(int))
        places = viewpoints.places[chosen]
        trained = viewpoints.trained[places]
        number = len(surface.points)
        points = np.linspace(0, number - 1, min(number, ANGLE_POINTS)).astype(int)
        total = np.zeros((len(places), len(places)))
        shared = np.zeros_like(total)
        widest: list[float] = []
        for point in points:
            rays = surface.points[point] - viewpoints.centers[places]
            rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
            angles = np.degrees(np.arccos(np.clip(rays @ rays.T, -1, 1)))
            seen = surface.seen[chosen, point]
            both = seen[:, None] & seen
            total += np.where(both, angles, 0)
            shared += both
            used = seen & trained
            if used.sum() > 1:
                widest.append(float(angles[np.ix_(used, used)].max()))
        own = np.maximum(np.diag(shared), 1)
        near = (shared >= OVERLAP * own[:, None]) & (shared > 0) & trained
        # Views from one place, as of a panorama, tell no depth to each other.
        centers = viewpoints.centers[places]
        near &= np.linalg.norm(centers[:, None] - centers, axis=2) > SAME_POSE
        mean = np.where(near, total / np.maximum(shared, 1), np.inf).min(1, initial=np.inf)
        nearest = np.where(np.isfinite(mean), mean, np.nan)
        return Angles(nearest, float(np.median(widest)) if widest else 0.0, tuple(places.tolist()))
