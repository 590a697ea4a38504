"""Surface points of a capture: plans, plane sweeps, and the fusion of their depths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.operators import Operators
from gsfw.core.stereo.fusion import FusedImage, FusionRule
from gsfw.core.stereo.plane_sweep import DepthImage
from gsfw.core.stereo.plans import (
    SeenPlaces,
    assumed_places,
    depth_ranges,
    neighbors_of,
    seen_places,
    sweep_plans,
)
from gsfw.core.stereo.views import StereoViews

SWEPT_NEIGHBORS = 4
"""Neighbours that a view is compared with."""
CONFIRMING_NEIGHBORS = 10
"""Neighbours that may confirm its points."""
LEAST_SCORE = 0.3
"""Least match of a pixel; what is wrong finds no confirmation."""
LEAST_CONTRAST = 0.02
"""Least cost of a mean plane above the best one's; with less, every plane fits."""
ROUGH_PIXELS = 6000
"""Pixels of an image in the first sweep, where no points tell how far surfaces are."""
ROUGH_RULE = FusionRule(depth_tolerance=0.06)
"""Depths of such small images are less exact."""
TELLING_POINTS = 100
"""So many points of a capture tell how far surfaces are."""
EVEN_SHARE = 0.05
"""Contrast that is added to every point's when points are chosen: plain surfaces need some, too."""


@dataclass(frozen=True)
class SurfacePoints:
    """Points on surfaces, each once; ordered by view and row."""

    points: Float[Tensor, "p 3"]
    """In the scene frame."""
    colors: Float[Tensor, "p 3"]
    """In [0, 1]."""
    contrasts: Float[Tensor, " p"]
    """Largest difference of grey across the point's pixel, in [0, 1]."""
    confirmed: float
    """Share of the pixels, less empty and unknown ones, that enough views confirm."""

    def __len__(self) -> int:
        return len(self.points)

    def thinned(self, most: int) -> SurfacePoints:
        """At most ``most`` of the points, more of them where the image changes."""
        if len(self) <= most:
            return self
        weights = (self.contrasts.double() + EVEN_SHARE).cumsum(0)
        steps = (torch.arange(most, dtype=torch.float64) + 0.5) * (weights[-1] / most)
        rows = torch.searchsorted(weights, steps).clamp_max(len(self) - 1).unique()
        return replace(
            self,
            points=self.points[rows],
            colors=self.colors[rows],
            contrasts=self.contrasts[rows],
        )


def surface_points(
    views: StereoViews,
    known: Float[Tensor, "p 3"],
    bounds: tuple[float, float],
    operators: Operators,
) -> SurfacePoints:
    """Points that neighbouring views agree on; none where the views have no neighbours.

    Args:
        views: images of one instant.
        known: points on the surface, from which depths and neighbours follow; may be empty.
        bounds: least and largest depth if there are too few of them, in scene units.
        operators: do the work.
    """
    places = known.double()
    if len(known) < TELLING_POINTS:
        rough = views.shrunk(ROUGH_PIXELS)
        assumed = assumed_places(rough, *bounds)
        places = _sweep(rough, assumed, bounds, ROUGH_RULE, operators).points.double()
    seen = seen_places(views, places) if len(places) else assumed_places(views, *bounds)
    return _sweep(views, seen, bounds, FusionRule(), operators)


def _sweep(
    views: StereoViews,
    seen: Sequence[SeenPlaces],
    bounds: tuple[float, float],
    rule: FusionRule,
    operators: Operators,
) -> SurfacePoints:
    """Points at the depths and with the neighbours that the seen places suggest."""
    neighbors = neighbors_of(views, seen, CONFIRMING_NEIGHBORS)
    compared = [others[:SWEPT_NEIGHBORS] for others in neighbors]
    plans = sweep_plans(views, compared, depth_ranges(seen, bounds))
    depths = [torch.zeros(views.size(view)) for view in range(len(views))]
    for plan, found in zip(plans, operators.sweep_views(views, plans), strict=True):
        depths[plan.view] = _trusted(views, plan.view, found)
    needed = min(rule.confirmations, max(map(len, neighbors), default=0))
    rule = replace(rule, confirmations=max(needed, 1))
    return _gathered(views, operators.fuse_views(views, depths, neighbors, rule))


def _trusted(views: StereoViews, view: int, found: DepthImage) -> Float[Tensor, "h w"]:
    """Depths of the pixels that fit well and show something; 0 elsewhere."""
    good = (found.scores > LEAST_SCORE) & (found.contrasts > LEAST_CONTRAST)
    good &= ~views.empty[view] & ~views.unknown[view]
    return torch.where(good, found.depths, 0.0)


def _gathered(views: StereoViews, fused: Sequence[FusedImage]) -> SurfacePoints:
    rows = [image.kept for image in fused]
    shown = sum(
        int((~(empty | unknown)).sum())
        for empty, unknown in zip(views.empty, views.unknown, strict=True)
    )
    confirmed = sum(int(image.confirmed.sum()) for image in fused)
    return SurfacePoints(
        torch.cat([image.points[kept] for image, kept in zip(fused, rows, strict=True)]),
        torch.cat([color[kept] for color, kept in zip(views.colors, rows, strict=True)]),
        torch.cat([_contrast(grey)[kept] for grey, kept in zip(views.grey, rows, strict=True)]),
        confirmed / max(shown, 1),
    )


def _contrast(grey: Float[Tensor, "h w"]) -> Float[Tensor, "h w"]:
    """Difference of the pixels on both sides of each pixel, the larger of both directions."""
    across, down = torch.zeros_like(grey), torch.zeros_like(grey)
    across[:, 1:-1] = (grey[:, 2:] - grey[:, :-2]).abs()
    down[1:-1] = (grey[2:] - grey[:-2]).abs()
    return torch.maximum(across, down)
