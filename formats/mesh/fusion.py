"""Fusion of depth images: the truncated signed distance of voxels, and their colours.

Curless and Levoy 1996, "A Volumetric Method for Building Complex Models from Range Images": each
voxel has the mean of its distances to the surface along the axes of the views, those behind the
surface by more than the truncation being left out; colours are the means of pixels near it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from torch import Tensor

from gsfw.core.exchange import DepthView
from gsfw.core.maths.rays import pixel_rays
from gsfw.core.progress import tracked
from gsfw.formats.mesh.blocks import SIDE, Blocks

BLOCKS_AT_ONCE = 2048
"""Blocks that are seen by a view at once: a million voxels."""
JUMP = 0.03
"""Relative step of depth between neighbouring pixels at which neither is trusted: rendered depth is
a mean over all splats of a pixel, and lies between the surfaces at an edge."""


@dataclass(frozen=True)
class FusionRule:
    """Rule of the depths that count, and of their reach."""

    truncation: float
    """Distance from the surface within which voxels know it, in the world of the data."""
    max_depth: float
    """Depths beyond it are ignored."""
    least_alpha: float
    """Coverage of pixels that show a surface."""


@dataclass(frozen=True)
class Fused:
    """Values of all voxels, in the order of ``Blocks.cells``."""

    distances: Float32[np.ndarray, " v"]
    """Mean signed distance to the surface in truncations, in [-1, 1]; positive in front of it."""
    counts: Float32[np.ndarray, " v"]
    """Number of views."""
    colors: Float32[np.ndarray, "v 3"]
    """In [0, 1]; NaN where no view shows a surface near it."""


def trusted(view: DepthView, rule: FusionRule) -> Bool[Tensor, "h w"]:
    """Pixels whose depth is that of a surface."""
    depth = view.depth
    good = depth.isfinite() & (depth > 0) & (depth <= rule.max_depth)
    good &= view.alpha >= rule.least_alpha
    padded = torch.nn.functional.pad(depth[None, None], (1, 1, 1, 1), mode="replicate")[0, 0]
    for across, down in ((0, 1), (2, 1), (1, 0), (1, 2)):
        shifted = padded[down : down + depth.shape[0], across : across + depth.shape[1]]
        good &= (shifted - depth).abs() <= JUMP * depth
    return good


def surface_points(view: DepthView, rule: FusionRule) -> Iterator[Float[np.ndarray, "n 3"]]:
    """Points in front of, on, and behind the surface that a view shows, in float64."""
    rays = pixel_rays(view.camera)[0].double()
    origins, directions = rays[..., :3], rays[..., 3:]
    axis = view.camera.world_to_camera[0, 2, :3].double()
    along = directions / (directions @ axis)[..., None]
    good = trusted(view, rule)
    for reach in (0.0, -rule.truncation, rule.truncation):
        points = origins[good] + along[good] * (view.depth[good].double() + reach)[:, None]
        yield points.numpy()


def fuse(blocks: Blocks, views: Sequence[DepthView], rule: FusionRule) -> Fused:
    """Fuse all views.

    Args:
        blocks: the voxels.
        views: with pinhole cameras.
        rule: which depths count.
    """
    count = len(blocks) * SIDE**3
    distances, counts = torch.zeros(count), torch.zeros(count)
    colors, colored = torch.zeros(count, 3), torch.zeros(count)
    masks = [trusted(view, rule) for view in views]
    starts = range(0, len(blocks), BLOCKS_AT_ONCE)
    for start in tracked(starts, "fusing depth images", len(starts)):
        points = torch.from_numpy(blocks.places(blocks.cells(slice(start, start + BLOCKS_AT_ONCE))))
        own = slice(start * SIDE**3, start * SIDE**3 + len(points))
        for view, mask in zip(views, masks, strict=True):
            seen = _seen(points, view, mask, rule)
            distances[own].index_add_(0, seen.rows, seen.distances)
            counts[own].index_add_(0, seen.rows, torch.ones_like(seen.distances))
            near = seen.distances.abs() * rule.truncation <= blocks.voxel
            colors[own].index_add_(0, seen.rows[near], seen.colors[near])
            colored[own].index_add_(0, seen.rows[near], torch.ones(int(near.sum())))
    return Fused(
        (distances / counts.clamp_min(1)).numpy(),
        counts.numpy(),
        (colors / colored[:, None]).numpy(),
    )


@dataclass(frozen=True)
class _Seen:
    """Voxels that a view sees."""

    rows: Tensor
    distances: Float[Tensor, " s"]
    colors: Float[Tensor, "s 3"]


def _seen(
    points: Float[Tensor, "v 3"], view: DepthView, mask: Bool[Tensor, "h w"], rule: FusionRule
) -> _Seen:
    """The voxels of a view's pixels, in front of the surface or little behind it."""
    pose, lens = view.camera.world_to_camera[0].double(), view.camera.intrinsics[0].double()
    local = (points @ pose[:3, :3].T + pose[:3, 3]).float()
    depth = local[:, 2]
    ahead = (depth > 0).nonzero()[:, 0]
    image = (
        local[ahead, :2] / depth[ahead, None] * lens.diagonal()[:2].float() + lens[:2, 2].float()
    )
    across, down = image.floor().long().unbind(1)
    height, width = mask.shape
    inside = (across >= 0) & (across < width) & (down >= 0) & (down < height)
    rows, pixel = ahead[inside], (down * width + across)[inside]
    there = mask.flatten()[pixel]
    rows, pixel = rows[there], pixel[there]
    away = (view.depth.flatten()[pixel] - depth[rows]) / rule.truncation
    known = away >= -1
    return _Seen(rows[known], away[known].clamp_max(1), view.color.view(-1, 3)[pixel[known]])
