"""TrackColors: the colours of matched points in the images that show them.

A colour is the mean of a patch under a Gaussian, so that a match that is off by a pixel hardly
moves it. The patch lies in space, across the mean direction that its point is seen from, and so
covers about the same of the surface in all images: else those nearer, or less aslant, would show
finer texture, and how fine it is would look as if it came with the direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch.nn.functional import grid_sample

from gsfw.core.batch import Batch
from gsfw.core.datamanager import DataManager
from gsfw.core.progress import tracked
from gsfw.datamanagers.capture import Capture
from gsfw.preparation.check.small_images import load_small
from gsfw.preparation.check.viewpoints import Viewpoints
from gsfw.preparation.image_quality import MEASURED_SIDE

SIGMA = 1.5
"""Size of the Gaussian in pixels of the image that shows the surface coarsest: COLMAP keeps matches
up to 4 pixels off, and the usual ones are off by 1."""
REACH, STEPS = 2.5, 9
"""Half the side of the patch in standard deviations, and the samples along its side."""
SHOWN = 0.99
"""Part of the patch that has to lie in the image, and to count there."""
MIN_VIEWS = 8
"""Images of a point, twice as many as degree 1 has coefficients: with fewer, what a fit foretells
is uncertain. Even of fox's points in 8 to 12 images only 25 % show that they need more than one
colour, of those in 21 and more 58 %."""
MAX_POINTS = 3000
"""Largest number of measured points, drawn with a fixed seed: shares are known to about 1 %."""
FINEST = 4.0
"""Images that show the surface finer than the coarsest by more than this are left out."""


@dataclass(frozen=True)
class TrackColors:
    """``o`` observations of ``p`` points."""

    rows: Int[np.ndarray, " p"]
    """Indices of the points, among those of the scene."""
    points: Int[np.ndarray, " o"]
    """Index of each observation's point in ``rows``; ascending."""
    views: Int[np.ndarray, " o"]
    """Its image, among the viewpoints."""
    directions: Float[np.ndarray, "o 3"]
    """Unit vectors from camera to point."""
    colors: Float[np.ndarray, "o 3"]
    """In [0, 1]."""
    misplaced: Float[np.ndarray, " o"]
    """Variance of a channel there, over all places that are off by the reprojection error."""

    @staticmethod
    def of(data: DataManager, viewpoints: Viewpoints, views: Sequence[int]) -> TrackColors:
        """Sample the images of some views; none where nobody said which show which point.

        Args:
            data: where images come from.
            viewpoints: of the same data.
            views: numbers of those that decode.
        """
        places = TrackPlaces.of(data, viewpoints, views)
        colors = np.full((len(places.rows), 3), np.nan)
        slopes = np.full(len(places.rows), np.nan)
        steps, axes, sizes = _steps(), places.axes, measured_sizes(viewpoints)
        shown = np.unique(places.views).tolist()
        for view in tracked(shown, "comparing colours of points", len(shown)):
            split, number = viewpoints.splits[view], viewpoints.numbers[view]
            batch = load_small(data, split, number, *sizes[view].tolist())
            here = places.views == view
            patches = places.points[here, None] + SIGMA * steps @ axes[here]
            pixels, _ = viewpoints.project(view, patches.reshape(-1, 3))
            relative = pixels.reshape(-1, len(steps), 2) / viewpoints.sizes[view]
            sigmas = SIGMA * places.zooms[here]
            colors[here], slopes[here] = _looked_up(batch, relative, steps, sigmas)
        kept = often(places.rows, np.isfinite(slopes))
        rows, points = np.unique(places.rows[kept], return_inverse=True)
        return TrackColors(
            rows=rows,
            points=points,
            views=places.views[kept],
            directions=places.directions[kept],
            colors=colors[kept],
            # A shift of length e to any side moves a value of slope g by g e / sqrt(2).
            misplaced=(slopes[kept] * places.errors[kept]) ** 2 / 2,
        )


def _steps() -> Float[np.ndarray, "s 2"]:
    """Sample positions of a patch, in standard deviations."""
    axis = np.linspace(-REACH, REACH, STEPS)
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


def _looked_up(
    batch: Batch,
    places: Float[np.ndarray, "o s 2"],
    steps: Float[np.ndarray, "s 2"],
    sigmas: Float[np.ndarray, " o"],
) -> tuple[Float[np.ndarray, "o 3"], Float[np.ndarray, " o"]]:
    """Mean colours, and how steep they are per pixel; NaN where a patch is not all in the image.

    Args:
        batch: of one image.
        places: samples of the patches, in widths and heights of the image.
        steps: of the samples from the middle, in standard deviations.
        sigmas: these deviations in pixels.
    """
    counts = torch.ones_like(batch.images[..., :1])
    for part in (batch.valid, batch.coverage):
        counts = counts if part is None else counts * part
    layers = torch.cat([batch.images, counts], dim=-1).permute(0, 3, 1, 2)
    grid = torch.from_numpy(2 * places - 1).float()[None]
    samples = grid_sample(layers, grid, align_corners=False)[0].double().numpy()
    weights = np.exp(-np.square(steps).sum(1) / 2)
    weights /= weights.sum()
    means = samples @ weights
    # Least squares: exact where the colour is linear.
    slopes = samples[:3] @ (weights[:, None] * steps) / (weights @ np.square(steps[:, 0]))
    steep = np.sqrt(np.square(slopes).sum(2).mean(0)) / sigmas
    shown = np.where(means[3] >= SHOWN, 1.0, np.nan)
    return (means[:3] * shown).T, steep * shown


@dataclass(frozen=True)
class TrackPlaces:
    """``o`` observations of points; lengths in pixels of images shrunk to ``MEASURED_SIDE``."""

    rows: Int[np.ndarray, " o"]
    """Index of each point in the scene; ascending."""
    views: Int[np.ndarray, " o"]
    """Index of each image among the viewpoints."""
    points: Float[np.ndarray, "o 3"]
    """Positions of the points."""
    directions: Float[np.ndarray, "o 3"]
    """Unit vectors from camera to point."""
    errors: Float[np.ndarray, " o"]
    """Reprojection error of the point, as a mean over all its images."""
    footprints: Float[np.ndarray, " o"]
    """Size of a pixel on the surface, in scene units."""

    @staticmethod
    def of(data: DataManager, viewpoints: Viewpoints, views: Sequence[int]) -> TrackPlaces:
        """The places of a sample of the points that enough of some views show."""
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
        """Resolution of a point in each image, relative to its coarsest image; >= 1."""
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
    """True for usable observations of points that have ``MIN_VIEWS`` of them or more."""
    counts = np.bincount(rows[usable], minlength=rows.max(initial=0) + 1)
    return usable & (counts[rows] >= MIN_VIEWS)


def measured_sizes(viewpoints: Viewpoints) -> Int[np.ndarray, "v 2"]:
    """Widths and heights at which the images are looked at."""
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
