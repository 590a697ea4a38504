"""ModelFigures: how good a reconstruction is, in numbers.

Everything is computed from the model's own points, poses and cameras: nothing here knows images.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float64, Int64

from gsfw.preparation.camera_grouping import CameraGroup
from gsfw.preparation.diagnosis.own_focals import own_focals
from gsfw.preparation.diagnosis.residuals import Stretch, errors_of, residuals_of, stretch_of
from gsfw.preparation.mapping.observations import Observations
from gsfw.preparation.parallel_views import view_spread

if TYPE_CHECKING:
    from pycolmap import Camera, Reconstruction

NARROW = 5.0
"""Degrees; depths of points that are seen within less are uncertain by tenths of them."""
TOO_NARROW = 1.5
"""Degrees; COLMAP itself drops points of less."""
AT_ONCE = 4_000_000
"""Pairs of rays whose angles are in memory together: 32 MB."""


@dataclass(frozen=True)
class CameraFigures:
    """One camera of a model."""

    number: int
    """COLMAP's id."""
    model: str
    """COLMAP's name of it, such as SIMPLE_RADIAL."""
    width: int
    """Pixels."""
    height: int
    images: int
    """Number of its images that have a pose."""
    focal: float
    """Pixels, the mean of both directions."""
    first_focal: float | None
    """Initial focal length; ``None`` where it is not known."""
    focal_origin: str
    """Source of the focal length: "EXIF", "given", or "" for a usual one."""
    view_degrees: float
    """Field of view across the width, as of ``gsfw check``; by the focal length alone."""
    principal_point: tuple[float, float]
    """Pixels."""
    distortion: dict[str, float]
    """The other parameters, by COLMAP's names."""

    @property
    def focal_ratio(self) -> float | None:
        """Focal length over the assumed one; ``None`` where that is not known."""
        return self.focal / self.first_focal if self.first_focal else None


@dataclass(frozen=True)
class TrackFigures:
    """Statistics of tracks; not-a-number for a model without points."""

    mean_length: float
    """Images that see a point."""
    share_of_pairs: float
    """Share of points that only two images see."""
    median_degrees: float
    """Median of the widest angle between two rays to a point."""
    low_degrees: float
    """10th percentile of that."""
    share_too_narrow: float
    """Share of points seen within less than ``TOO_NARROW``."""
    share_narrow: float
    """Share of points seen within less than ``NARROW``."""


@dataclass(frozen=True)
class BaselineFigures:
    """Distances between cameras; NaN if there is only one."""

    spread: float
    """Root mean square distance of the cameras from their middle, in units of the model."""
    to_depth: float
    """Median over cameras: distance to the nearest other one, over the median depth of the points
    that it sees."""
    degrees: float
    """Median over cameras: angle between its viewing direction and that of this other one."""
    view_spread: float
    """Largest angle between a viewing direction and the mean of all, in degrees."""
    cloud_to_spread: float
    """Size of the point cloud (twice the distance of 90 % of the points from their median) over
    twice the spread of the cameras."""


@dataclass(frozen=True)
class ModelFigures:
    """A model in numbers; a mean over nothing is not-a-number."""

    registered: int
    """Images with a pose."""
    points: int
    observations: int
    error: float
    """Mean reprojection error in pixels over observations; COLMAP takes the mean over points, in
    which long tracks count for less."""
    errors: dict[str, float]
    """The same of each image that sees a point, by name."""
    seen: dict[str, int]
    """Number of points that each image sees, by name."""
    tracks: TrackFigures
    baselines: BaselineFigures
    cameras: tuple[CameraFigures, ...]
    stretch: Stretch
    """Stretch of images by their own motion, as of a rolling shutter."""
    own_focals: dict[str, float]
    """Focal lengths in pixels of images that surely have another than their camera, by name."""

    @staticmethod
    def of(model: Reconstruction, groups: Sequence[CameraGroup] = ()) -> ModelFigures:
        """Measure a model.

        Args:
            model: with points and poses.
            groups: what was assumed of its cameras, by the same numbers.
        """
        seen = Observations.of(model)
        names = [model.image(int(number)).name for number in seen.image_ids]
        places, offsets = residuals_of(model, seen)
        return ModelFigures(
            registered=len(names),
            points=len(seen.positions),
            observations=len(seen.points),
            error=_mean(np.linalg.norm(offsets, axis=1)),
            errors=errors_of(model, seen, offsets),
            seen=dict(zip(names, seen.counts.tolist(), strict=True)),
            tracks=_tracks(model, seen),
            baselines=_baselines(model, seen),
            cameras=_cameras(model, groups),
            stretch=stretch_of(model, seen, places, offsets),
            own_focals=own_focals(model, [one.number for one in groups if one.view is not None]),
        )

    def document(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)


def _tracks(model: Reconstruction, seen: Observations) -> TrackFigures:
    centers = np.array([model.image(int(n)).projection_center() for n in seen.image_ids])
    angles = widest_angles(seen, centers.reshape(-1, 3))
    return TrackFigures(
        mean_length=_mean(seen.lengths),
        share_of_pairs=_mean(seen.lengths == 2),
        median_degrees=_percentile(angles, 50),
        low_degrees=_percentile(angles, 10),
        share_too_narrow=_mean(angles < TOO_NARROW),
        share_narrow=_mean(angles < NARROW),
    )


def _baselines(model: Reconstruction, seen: Observations) -> BaselineFigures:
    images = [model.image(int(number)) for number in seen.image_ids]
    if len(images) < 2:
        return BaselineFigures(*[float("nan")] * 5)
    centers = np.array([image.projection_center() for image in images])
    views = np.array([image.viewing_direction() for image in images])
    frames = np.array([image.frame_id for image in images])
    distances, cosines = _nearest(centers, views, frames)
    depths = ((seen.positions[seen.points] - centers[seen.images]) * views[seen.images]).sum(1)
    ratios = [
        distance / np.median(depths[own])
        for distance, (_, own) in zip(distances, seen.by_image(), strict=True)
        if len(own)
    ]
    spread = float(np.sqrt(((centers - centers.mean(axis=0)) ** 2).sum(axis=1).mean()))
    return BaselineFigures(
        spread=spread,
        to_depth=_percentile(np.array(ratios), 50),
        degrees=float(np.median(np.degrees(np.arccos(cosines)))),
        view_spread=view_spread(views),
        cloud_to_spread=_cloud_radius(seen.positions) / spread if spread else float("nan"),
    )


def _nearest(
    centers: Float64[np.ndarray, "r 3"],
    views: Float64[np.ndarray, "r 3"],
    frames: Int64[np.ndarray, " r"],
) -> tuple[Float64[np.ndarray, " r"], Float64[np.ndarray, " r"]]:
    """Distance of each camera to the nearest other one, and the cosine between their directions.

    Views of one panorama, which share a frame, have their neighbour in another, if there is one:
    the view there of the most similar direction.
    """
    from scipy.spatial import KDTree

    _, first, own = np.unique(frames, return_index=True, return_inverse=True)
    if len(first) < 2:
        return np.zeros(len(centers)), np.ones(len(centers))
    distances, neighbors = KDTree(centers[first]).query(centers[first], k=2)
    # Of two cameras in one place either may come first.
    itself = neighbors[:, 0] == np.arange(len(first))
    there = np.where(itself, neighbors[:, 1], neighbors[:, 0])[own]
    cosines = np.array(
        [(views[own == other] @ view).max() for view, other in zip(views, there, strict=True)]
    )
    return distances[own, 1], cosines.clip(-1, 1)


def _cloud_radius(positions: Float64[np.ndarray, "p 3"]) -> float:
    if not len(positions):
        return float("nan")
    return _percentile(np.linalg.norm(positions - np.median(positions, axis=0), axis=1), 90)


def _cameras(model: Reconstruction, groups: Sequence[CameraGroup]) -> tuple[CameraFigures, ...]:
    assumed = {group.number: group for group in groups}
    used = [model.image(number).camera_id for number in model.reg_image_ids()]
    return tuple(
        _camera(model.camera(number), used.count(number), assumed.get(number))
        for number in sorted(set(used))
    )


def _camera(camera: Camera, images: int, assumed: CameraGroup | None) -> CameraFigures:
    names = [name.strip() for name in camera.params_info.split(",")]
    extra = camera.extra_params_idxs()
    half = camera.width / 2 / camera.mean_focal_length()
    # An equidistant fisheye's angle grows with the radius; a pinhole's tangent does.
    angle = half if "FISHEYE" in camera.model.name else np.arctan(half)
    return CameraFigures(
        number=camera.camera_id,
        model=camera.model.name,
        width=camera.width,
        height=camera.height,
        images=images,
        focal=float(camera.mean_focal_length()),
        first_focal=assumed.focal if assumed else None,
        focal_origin=assumed.focal_origin if assumed else "",
        view_degrees=float(np.degrees(2 * angle)),
        principal_point=(float(camera.principal_point_x), float(camera.principal_point_y)),
        distortion={names[index]: float(camera.params[index]) for index in extra},
    )


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else float("nan")


def _percentile(values: np.ndarray, percent: int) -> float:
    return float(np.percentile(values, percent)) if values.size else float("nan")


def widest_angles(
    seen: Observations, centers: Float64[np.ndarray, "r 3"]
) -> Float64[np.ndarray, " p"]:
    """The widest angle between any two rays to each point, in degrees; 0 where nothing sees it.

    Args:
        seen: which image sees which point.
        centers: where the images were taken from.
    """
    rays = centers[seen.images] - seen.positions[seen.points]
    norms = np.linalg.norm(rays, axis=1, keepdims=True)
    rays = rays / np.maximum(norms, np.finfo(np.float64).tiny)
    starts = np.cumsum(seen.lengths) - seen.lengths
    angles = np.zeros(len(seen.positions))
    # Points that equally many images see make one array, without gaps.
    for length in np.unique(seen.lengths[seen.lengths > 0]).tolist():
        chosen = np.flatnonzero(seen.lengths == length)
        for part in np.array_split(chosen, 1 + len(chosen) * length**2 // AT_ONCE):
            tracks = rays[starts[part, None] + np.arange(length)]
            cosines = (tracks @ tracks.transpose(0, 2, 1)).min(axis=(1, 2))
            angles[part] = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return angles
