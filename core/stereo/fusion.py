"""Fusion of depths: points that enough views agree on, once each.

Galliani et al. 2015, "Gipuma", section 4.4. A place is represented by the view that shows it most
closely, so that it has as many points as that view has pixels. This is the plain form;
``kernels/cpu/native/depth_fusion.cpp`` is the fast one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Float64
from torch import Tensor

from gsfw.core.stereo.views import StereoViews


@dataclass(frozen=True)
class FusionRule:
    """Thresholds of the agreement of views."""

    depth_tolerance: float = 0.02
    """Largest relative difference of two depths of a place."""
    pixel_tolerance: float = 1.5
    """Largest distance in pixels between a pixel and where the other view's depth leads back to."""
    confirmations: int = 2
    """Other views that have to agree."""
    contradictions: int = 1
    """Other views that may show background in place of a point: reflections look like it."""


@dataclass(frozen=True)
class FusedImage:
    """Depths and colours of the pixels of one view."""

    points: Float[Tensor, "h w 3"]
    """Mean of the places that the views which agree have found, in the scene frame."""
    kept: Bool[Tensor, "h w"]
    """Pixels that are to represent their place."""
    confirmed: Bool[Tensor, "h w"]
    """All pixels that enough views confirm; other points have no meaning."""


def fuse_views(
    views: StereoViews,
    depths: Sequence[Float[Tensor, "_ _"]],
    neighbors: Sequence[Sequence[int]],
    rule: FusionRule,
) -> list[FusedImage]:
    """Points of every view.

    Args:
        views: the images' cameras.
        depths: depth of each pixel; 0 where there is none.
        neighbors: views that may confirm those of a view.
        rule: when views agree.
    """
    doubles = [each.double() for each in depths]
    return [_fuse(views, doubles, view, neighbors[view], rule) for view in range(len(views))]


def _fuse(
    views: StereoViews,
    depths: Sequence[Float64[Tensor, "_ _"]],
    view: int,
    neighbors: Sequence[int],
    rule: FusionRule,
) -> FusedImage:
    pixels, own = views.pixel_centers(view), depths[view].flatten()
    place = views.unproject(view, pixels, own)
    total, size = place.clone(), own * _pixel_size(views, view)
    agreeing, contradicting = torch.zeros(len(own)), torch.zeros(len(own))
    closest = torch.ones(len(own), dtype=torch.bool)
    for other in neighbors:
        at, depth_seen, inside = views.project(other, place)
        height, width = views.size(other)
        columns = at[:, 0].nan_to_num().long().clamp(0, width - 1)
        rows = at[:, 1].nan_to_num().long().clamp(0, height - 1)
        contradicting += inside & views.empty[other][rows, columns]
        there = depths[other][rows, columns]
        found = views.unproject(other, torch.stack([columns, rows], dim=1).double() + 0.5, there)
        back, _, _ = views.project(view, found)
        agree = inside & (there > 0) & (back - pixels).norm(dim=1).lt(rule.pixel_tolerance)
        agree &= (there - depth_seen).abs() <= rule.depth_tolerance * depth_seen
        agreeing += agree
        total += torch.where(agree[:, None], found, 0.0)
        size_there = there * _pixel_size(views, other)
        closest &= ~agree | (size < size_there) | ((size == size_there) & (view < other))
    confirmed = (own > 0) & (agreeing >= rule.confirmations)
    confirmed &= contradicting <= rule.contradictions
    shape = views.size(view)
    points = (total / (agreeing + 1)[:, None]).float()
    kept = (confirmed & closest).view(shape)
    return FusedImage(points.view(*shape, 3), kept, confirmed.view(shape))


def _pixel_size(views: StereoViews, view: int) -> float:
    """Length of a pixel at a depth of 1."""
    focal = views.intrinsics[view, 0, 0] * views.intrinsics[view, 1, 1]
    return float(focal.abs().rsqrt())
