"""Agreement: whether images show the same colours where the points say they show the same thing.

Poses that belong to other images, or follow another convention, leave colours at random; a camera
that sets its exposure anew for each image moves them by a factor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from gsfw.preparation.check.image_sample import ImageSample
from gsfw.preparation.check.viewpoints import Surface, Viewpoints

MIN_VIEWS, MIN_POINTS = 3, 50
"""Points seen in fewer of the sampled images say nothing, and fewer points too little."""
NEAREST = 4
"""Number of images compared at each point, the nearest: whether other things hide it from the
rest, points alone cannot tell."""
ONE_SIDE = 30.0
"""Degrees from the nearest: from farther around, other things hide a point, or it shines."""
FLOOR = 0.03
"""Added to brightness before ratios are taken: dark pixels are mostly noise."""
EXCHANGES = 5
"""Largest number of exchanges of poses that ``scatter_by_chance`` tries."""
READABLE = (0.03, 0.97)
"""Brightness outside is clipped, and takes no part in ratios."""


@dataclass(frozen=True)
class Agreement:
    """Agreement of the sampled images on the colours of points."""

    scatter: float
    """Variance of a point's colours over images, in parts of that over all points: 0 where all
    images agree, about 1 where colours are at random."""
    gains: Float[np.ndarray, " l"]
    """Brightness of each sampled image relative to the others at the same points; NaN without."""
    points: int
    """Number of points that were compared."""

    @staticmethod
    def of(
        surface: Surface | None, viewpoints: Viewpoints, sample: ImageSample
    ) -> Agreement | None:
        """Over the sampled images; ``None`` where too few points are seen by enough of them."""
        if surface is None or not surface.measured or len(sample.images) < MIN_VIEWS:
            return None
        colors = np.stack(
            [_colors(surface, viewpoints, sample, i) for i in range(len(sample.images))]
        )
        colors[~_near(surface, viewpoints, sample, np.isfinite(colors[..., 0]))] = np.nan
        often = np.isfinite(colors[..., 0]).sum(0) >= MIN_VIEWS
        if often.sum() < MIN_POINTS:
            return None
        colors = colors[:, often]
        gains = _gains(colors.mean(2))
        even = colors / np.where(np.isfinite(gains), gains, 1.0)[:, None, None]
        within = np.nanvar(even, axis=0).mean()
        every = even[np.isfinite(even[..., 0])]
        total = every.var(axis=0).mean()
        # The mean of few samples is nearer to them than the true one.
        seen = np.isfinite(even[..., 0]).sum(0).mean()
        scatter = float(within / max(total, 1e-9) * seen / (seen - 1))
        return Agreement(scatter, gains, int(often.sum()))


def scatter_by_chance(
    surface: Surface | None, viewpoints: Viewpoints, sample: ImageSample
) -> float:
    """Median of ``Agreement.scatter`` with the poses of the sampled images exchanged, in circles.

    Images of wrong poses scatter as much; those of right ones less, also where fine texture or few
    images make colours of points uncertain. NaN where too few points can be compared.
    """
    images, found = sample.images, []
    for step in range(1, min(len(images), EXCHANGES + 1)):
        moved = [*images[step:], *images[:step]]
        exchanged = tuple(
            replace(image, view=other.view) for image, other in zip(images, moved, strict=True)
        )
        agreement = Agreement.of(surface, viewpoints, replace(sample, images=exchanged))
        found += [] if agreement is None else [agreement.scatter]
    return float(np.median(found)) if found else math.nan


def _near(
    surface: Surface, viewpoints: Viewpoints, sample: ImageSample, seen: Bool[np.ndarray, "l p"]
) -> Bool[np.ndarray, "l p"]:
    """True for images among the nearest that show a point from about one side.

    That side is the one of the nearest of them: fewest things stand in between.
    """
    centers = viewpoints.centers[[image.view for image in sample.images]]
    rays = surface.points - centers[:, None]
    away = np.linalg.norm(rays, axis=2)
    rays = rays / np.maximum(away, 1e-12)[..., None]
    first = np.where(seen, away, np.inf).argmin(0)
    cosines = (rays * rays[first, np.arange(len(first))]).sum(2)
    alike = seen & (cosines >= math.cos(math.radians(ONE_SIDE)))
    rank = np.argsort(np.argsort(np.where(alike, away, np.inf), axis=0), axis=0)
    return np.asarray(alike & (rank < NEAREST))


def _colors(
    surface: Surface, viewpoints: Viewpoints, sample: ImageSample, index: int
) -> Float[np.ndarray, "p 3"]:
    """Colours of all points in one sampled image; NaN where they are not in it."""
    image = sample.images[index]
    pixels, inside = viewpoints.project(image.view, surface.points)
    height, width = image.preview.shape[:2]
    scale = np.array([width, height]) / viewpoints.sizes[image.view]
    cells = np.floor(pixels[inside] * scale).astype(int)
    cells = np.clip(cells, 0, np.array([width, height]) - 1)
    colors = np.full((len(surface.points), 3), np.nan)
    colors[inside] = image.preview[cells[:, 1], cells[:, 0]]
    return colors


def _gains(brightness: Float[np.ndarray, "l p"]) -> Float[np.ndarray, " l"]:
    """Median ratio of each image's points to the median of the same points in all images."""
    low, high = READABLE
    readable = np.isfinite(brightness) & (brightness > low) & (brightness < high)
    gains = np.full(len(brightness), np.nan)
    logs = np.where(readable, np.log(np.where(readable, brightness, 1.0) + FLOOR), np.nan)
    enough = readable.sum(0) >= MIN_VIEWS
    usual = np.nanmedian(logs[:, enough], axis=0)
    for image, row in enumerate(logs[:, enough]):
        known = np.isfinite(row)
        if known.sum() >= MIN_POINTS // 2:
            gains[image] = np.exp(np.median(row[known] - usual[known]))
    return gains
