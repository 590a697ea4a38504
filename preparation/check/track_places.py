"""TrackPlaces: where matched points lie in the pictures that show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float, Int

from gsfw.core.datamanager import DataManager
from gsfw.datamanagers.capture import Capture
from gsfw.datamanagers.picture_quality import MEASURED_SIDE
from gsfw.preparation.check.viewpoints import Viewpoints

MIN_VIEWS = 8
"""Pictures of a point, twice as many as degree 1 has coefficients: with fewer, what a fit foretells
is uncertain. Even of fox's points in 8 to 12 pictures only 25 % show that they need more than one
colour, of those in 21 and more 58 %."""
MAX_POINTS = 3000
"""So many are measured, drawn with a fixed seed: shares are then known to about 1 %."""
FINEST = 4.0
"""Pictures that show the surface finer than the coarsest by more than this are left out."""


@dataclass(frozen=True)
class TrackPlaces:
    """``o`` observations of points; lengths in pixels of pictures shrunk to ``MEASURED_SIDE``."""

    rows: Int[np.ndarray, " o"]
    """Of each point among those of the scene; ascending."""
    views: Int[np.ndarray, " o"]
    """Of each picture among the viewpoints."""
    points: Float[np.ndarray, "o 3"]
    """Where they are."""
    directions: Float[np.ndarray, "o 3"]
    """Unit vectors from camera to point."""
    errors: Float[np.ndarray, " o"]
    """How far the point is from where it was matched, as a mean over all its pictures."""
    footprints: Float[np.ndarray, " o"]
    """What a pixel covers of the surface, in scene units."""

    @staticmethod
    def of(data: DataManager, viewpoints: Viewpoints, views: Sequence[int]) -> TrackPlaces:
        """Of a sample of the points that enough of some views show."""
        rows, seen, errors = _observations(data, viewpoints, views)
        points = data.scene.points.double().numpy()[rows]
        offsets = points - viewpoints.centers[seen]
        depths = (offsets * viewpoints.axes[seen]).sum(1)
        shrunk = measured_sizes(viewpoints)[:, 0] / viewpoints.sizes[:, 0]
        focals = shrunk * viewpoints.intrinsics[:, 0, 0]
        places = TrackPlaces(
            rows=rows,
            views=seen,
            points=points,
            directions=offsets / np.linalg.norm(offsets, axis=1, keepdims=True),
            errors=errors * focals[seen],
            footprints=depths / focals[seen],
        ).where(depths > 0)
        return places.where(often(places.rows, places.zooms <= FINEST))

    @property
    def zooms(self) -> Float[np.ndarray, " o"]:
        """How much finer a picture shows a point than the one that shows it coarsest; >= 1."""
        coarsest = np.zeros(self.rows.max(initial=0) + 1)
        np.maximum.at(coarsest, self.rows, self.footprints)
        return coarsest[self.rows] / self.footprints

    @property
    def axes(self) -> Float[np.ndarray, "o 2 3"]:
        """Across the mean direction that a point is seen from, as long as its coarsest pixel."""
        means = np.zeros((self.rows.max(initial=0) + 1, 3))
        np.add.at(means, self.rows, self.directions)
        across = np.cross(means, np.eye(3)[np.abs(means).argmin(1)])
        axes = np.stack([across, np.cross(means, across)], axis=1)[self.rows]
        lengths = self.zooms * self.footprints
        return axes / np.linalg.norm(axes, axis=2, keepdims=True) * lengths[:, None, None]

    def where(self, chosen: Bool[np.ndarray, " o"]) -> TrackPlaces:
        """Some of them."""
        return TrackPlaces(*(getattr(self, field.name)[chosen] for field in fields(self)))


def often(rows: Int[np.ndarray, " o"], usable: Bool[np.ndarray, " o"]) -> Bool[np.ndarray, " o"]:
    """Which usable observations are of points that have ``MIN_VIEWS`` of them or more."""
    counts = np.bincount(rows[usable], minlength=rows.max(initial=0) + 1)
    return usable & (counts[rows] >= MIN_VIEWS)


def measured_sizes(viewpoints: Viewpoints) -> Int[np.ndarray, "v 2"]:
    """Widths and heights at which the pictures are looked at."""
    shrink = np.minimum(1.0, MEASURED_SIDE / viewpoints.sizes.max(1, keepdims=True))
    return np.maximum(1, np.round(viewpoints.sizes * shrink)).astype(np.int64)


def _observations(
    data: DataManager, viewpoints: Viewpoints, views: Sequence[int]
) -> tuple[Int[np.ndarray, " o"], Int[np.ndarray, " o"], Float[np.ndarray, " o"]]:
    """Point, view, and reprojection error as an angle near the axis, of a sample of the points."""
    if not isinstance(data, Capture):
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    sightings, frames = data.recording.read_sightings(), data.recording.frames
    number = {name: view for view, name in enumerate(viewpoints.names)}
    view_of = np.array([number[frame.name] for frame in frames])
    focal = np.array([frame.lens.fx for frame in frames])
    used = np.isin(view_of[sightings.frames], views)
    rows, seen = sightings.points[used], sightings.frames[used]
    enough = np.flatnonzero(np.bincount(rows) >= MIN_VIEWS)
    if len(enough) > MAX_POINTS:
        enough = np.random.default_rng(0).choice(enough, MAX_POINTS, replace=False)
    drawn = np.isin(rows, enough)
    rows, seen = rows[drawn], seen[drawn]
    return rows, view_of[seen], sightings.errors[rows] / focal[seen]
