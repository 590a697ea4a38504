"""Sweep plans: which cameras each camera is compared with, and between which depths.

Both follow from places on the surface that the cameras see, which may be few and rough: the points
of a structure from motion, or those of a sweep over small images.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float64
from torch import Tensor
from torch.nn.functional import normalize

from gsfw.core.stereo.views import StereoViews

BEST_ANGLE = 7.0
"""Angle in degrees between two rays to a place that stereo works best with."""
SMALLER_ANGLES, LARGER_ANGLES = 2.0, 12.0
"""Standard deviations of the worth of other angles: with smaller ones depths are not exact, with
larger ones surfaces look different (Yao et al. 2018, "MVSNet", section 4.1, has 5, 1 and 10)."""
LEAST_WORTH = 0.02
"""A camera whose angles to what it shares are worth less, 1 being the best, is no neighbour."""
LEAST_SHARED = 0.05
"""Nor is one that shares less of the places."""
PLACES = 64
"""Places of a view that its neighbours are judged by."""
LEAST_PLACES = 20
"""A view that sees fewer takes the range of depths of all views."""
OUTERMOST = 0.01
"""Part of a view's places at either end that may be wrong."""
MARGIN = 1.25
"""Planes reach beyond the remaining places by this factor."""
LEAST_PLANES, MOST_PLANES = 16, 128
"""Planes of a sweep; between these, one for each pixel by which the first and the last differ in a
neighbour's image."""


@dataclass(frozen=True)
class SweepPlan:
    """The sweep of one view."""

    view: int
    neighbors: tuple[int, ...]
    """Views that it is compared with, the best first; not empty."""
    near: float
    """Depth of the first plane, in scene units; positive."""
    far: float
    """Depth of the last one; more than ``near``."""
    planes: int
    """Number of planes, at equal steps of their inverse depths."""


@dataclass(frozen=True)
class SeenPlaces:
    """Places on the surface that one view sees."""

    places: Float64[Tensor, "p 3"]
    depths: Float64[Tensor, " p"]


def seen_places(views: StereoViews, places: Float64[Tensor, "p 3"]) -> list[SeenPlaces]:
    """True for places that each view sees, as if there were nothing in front of them."""
    found = []
    for view in range(len(views)):
        _, depths, inside = views.project(view, places)
        found.append(SeenPlaces(places[inside], depths[inside]))
    return found


def assumed_places(views: StereoViews, near: float, far: float) -> list[SeenPlaces]:
    """Places all over the space that each view sees between two depths."""
    found = []
    shares = torch.tensor([0.15, 0.4, 0.6, 0.85], dtype=torch.float64)
    across = torch.stack(torch.meshgrid(shares, shares, indexing="ij"), dim=-1).reshape(-1, 2)
    for view in range(len(views)):
        height, width = views.size(view)
        pixels = (across * torch.tensor([width, height])).repeat(len(shares), 1)
        depths = 1.0 / torch.lerp(
            1.0 / shares.new_tensor(near), 1.0 / shares.new_tensor(far), shares
        )
        depths = depths.repeat_interleave(len(across))
        found.append(SeenPlaces(views.unproject(view, pixels, depths), depths))
    return found


def depth_ranges(
    seen: Sequence[SeenPlaces], otherwise: tuple[float, float]
) -> list[tuple[float, float]]:
    """Least and largest depth of each view; ``otherwise`` where too few places tell."""
    ranges = [
        (float(each.depths.quantile(OUTERMOST)), float(each.depths.quantile(1.0 - OUTERMOST)))
        if len(each.depths) >= LEAST_PLACES
        else None
        for each in seen
    ]
    known = [each for each in ranges if each is not None]
    if known:
        otherwise = min(near for near, _ in known), max(far for _, far in known)
    return [(near / MARGIN, far * MARGIN) for near, far in (each or otherwise for each in ranges)]


def neighbors_of(views: StereoViews, seen: Sequence[SeenPlaces], most: int) -> list[list[int]]:
    """At most ``most`` views for each view that see the same places at good angles, best first."""
    return [_neighbors(views, view, each.places, most) for view, each in enumerate(seen)]


def _neighbors(
    views: StereoViews, view: int, places: Float64[Tensor, "p 3"], most: int
) -> list[int]:
    if len(places) == 0:
        return []
    count = min(len(places), PLACES)
    places = places[torch.arange(count) * len(places) // count]
    rays = normalize(places - views.centers[:, None], dim=2)
    angles = torch.rad2deg(torch.acos((rays * rays[view]).sum(2).clamp(-1.0, 1.0)))
    width = torch.where(angles < BEST_ANGLE, SMALLER_ANGLES, LARGER_ANGLES)
    gains = torch.exp(-0.5 * ((angles - BEST_ANGLE) / width).square())
    shared = views.visible(places).double()
    worth, share = (gains * shared).mean(1), shared.mean(1)
    fits = (share > LEAST_SHARED) & (worth > LEAST_WORTH * share)
    fits[view] = False
    order = torch.where(fits, worth, 0.0).argsort(descending=True, stable=True)
    return order[: min(most, int(fits.sum()))].tolist()


def sweep_plans(
    views: StereoViews,
    neighbors: Sequence[Sequence[int]],
    ranges: Sequence[tuple[float, float]],
) -> list[SweepPlan]:
    """Plans of all views that have neighbours."""
    return [
        SweepPlan(view, tuple(others), near, far, _planes(views, view, others, near, far))
        for view, (others, (near, far)) in enumerate(zip(neighbors, ranges, strict=True))
        if others
    ]


def _planes(
    views: StereoViews, view: int, neighbors: Sequence[int], near: float, far: float
) -> int:
    """A plane for each pixel of the longest way that a place can be shifted in a neighbour."""
    height, width = views.size(view)
    shares = torch.tensor([0.2, 0.5, 0.8], dtype=torch.float64)
    across = torch.stack(torch.meshgrid(shares, shares, indexing="ij"), dim=-1).reshape(-1, 2)
    pixels = across * torch.tensor([width, height])
    ends = [
        views.unproject(view, pixels, torch.full((len(pixels),), depth, dtype=torch.float64))
        for depth in (near, far)
    ]
    shifts = [
        (views.project(other, ends[0])[0] - views.project(other, ends[1])[0]).norm(dim=1).median()
        for other in neighbors
    ]
    return min(max(math.ceil(max(shifts)) + 1, LEAST_PLANES), MOST_PLANES)
