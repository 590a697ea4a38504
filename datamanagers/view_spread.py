"""View spread: views from all over a capture, and views that have no other beside them."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np
import torch
from jaxtyping import Float64, Int64

from gsfw.datamanagers.frames import Frame, Sightings

FEW_POINTS = 30
"""Fewest points of a view that tell what it shows: COLMAP places no image on fewer."""
SHARED = 0.5
"""Share of a view's points below which other views do not show what it does. Views of a sound
reconstruction share nearly all (held-out views of fox: 1.0), as a point takes two images."""
SAME_PLACE = 1e-5
"""Distance of two cameras in one place, in parts of the extent of all: what rounding to six digits
leaves of one centre. Two photos by hand are never computed as near."""
WIDEST_ANGLE = 90.0
"""Degrees between the axes of two views, from which on they share no surface except at grazing
angles; for views whose points are not known."""


def spread_views(frames: Sequence[Frame], count: int) -> list[int]:
    """Choose views from all over a capture, of which each keeps its nearest neighbour.

    Views are grouped around farthest points, by position and direction. In each group the view is
    chosen that is nearest to one that stays: it is missed least.

    Args:
        frames: the views to choose among.
        count: most views to choose; a group of one view gives none.

    Returns:
        Ascending positions.
    """
    apart = _distances(frames)
    seeds = _farthest(apart, min(count, len(frames)))
    groups = apart[:, seeds].argmin(axis=1)
    np.fill_diagonal(apart, np.inf)
    chosen: list[int] = []
    kept: set[int] = set()
    for group in range(len(seeds)):
        members = np.flatnonzero(groups == group)
        free = [int(member) for member in members if member not in kept]
        if len(members) < 2 or not free:
            continue
        rest = [other for other in range(len(frames)) if other not in chosen]
        nearest = apart[np.ix_(free, rest)]
        row, column = np.unravel_index(nearest.argmin(), nearest.shape)
        chosen.append(free[row])
        kept.add(rest[column])
    return sorted(chosen)


def places_of(frames: Sequence[Frame]) -> Int64[np.ndarray, " n"]:
    """The number of each view's place; views of a panorama share one.

    Places are numbered in the order of their first views.
    """
    if not frames:
        return np.zeros(0, np.int64)
    centers, _ = _centers_and_axes(frames)
    extent = float(np.linalg.norm(centers - centers.mean(axis=0), axis=1).max())
    if extent == 0:
        return np.zeros(len(frames), np.int64)
    return numbered_places(centers, SAME_PLACE * extent)


def numbered_places(centers: Float64[np.ndarray, "n 3"], apart: float) -> Int64[np.ndarray, " n"]:
    """The number of each centre's place, in the order of their first ones.

    Args:
        centers: of cameras.
        apart: distance up to which two centres are one place.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    # Many views from one place would be too many pairs; rounding joins most of them.
    distinct, row = np.unique((centers / apart).round(3), axis=0, return_inverse=True)
    near = KDTree(distinct).query_pairs(1.0, output_type="ndarray")
    size = (len(distinct), len(distinct))
    links = coo_matrix((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=size)
    labels = connected_components(links, directed=False)[1][row.reshape(-1)]
    _, first, place = np.unique(labels, return_index=True, return_inverse=True)
    ranks: Int64[np.ndarray, " p"] = first.argsort().argsort()
    return ranks[place]


def _distances(frames: Sequence[Frame]) -> Float64[np.ndarray, "n n"]:
    """Distances between views: of positions, in parts of the usual one, and of directions."""
    centers, axes = _centers_and_axes(frames)
    offsets = centers - np.median(centers, axis=0)
    scale = float(np.median(np.linalg.norm(offsets, axis=1))) or 1.0
    features = np.concatenate([offsets / scale, axes], axis=1)
    squares = (features**2).sum(1)
    products = features @ features.T
    distances: Float64[np.ndarray, "n n"] = squares[:, None] + squares - 2 * products
    return distances.clip(0) ** 0.5


def _farthest(apart: Float64[np.ndarray, "n n"], count: int) -> list[int]:
    """Positions of ``count`` views: the most central one, then always the one farthest from all."""
    chosen = [int(apart.sum(1).argmin())]
    while len(chosen) < count:
        chosen.append(int(apart[chosen].min(axis=0).argmax()))
    return chosen


def lonely_views(frames: Sequence[Frame], held: Collection[int], sightings: Sightings) -> list[int]:
    """Held-out views that show what no training view does, once those before them are trained on.

    Args:
        frames: all views.
        held: positions of the held-out ones.
        sightings: points of the views, whose rows are those of ``frames``; or none.

    Returns:
        Their positions, the loneliest first.
    """
    remaining, lonely = sorted(held), []
    while remaining:
        shares = _shares(frames, remaining, sightings)
        least = int(shares.argmin())
        if shares[least] >= SHARED:
            break
        lonely.append(remaining.pop(least))
    return lonely


def _shares(
    frames: Sequence[Frame], held: Sequence[int], sightings: Sightings
) -> Float64[np.ndarray, " h"]:
    """Share of each held-out view that training views show as well, in [0, 1]."""
    trained = np.ones(len(frames), bool)
    trained[held] = False
    shown = np.zeros(len(sightings.errors), bool)
    shown[sightings.points[trained[sightings.frames]]] = True
    _, axes = _centers_and_axes(frames)
    cosines = axes[held] @ axes[trained].T
    beside = cosines.max(axis=1, initial=-1.0) > math.cos(math.radians(WIDEST_ANGLE))
    counts = np.bincount(sightings.frames, minlength=len(frames))[held]
    common = np.bincount(sightings.frames, weights=shown[sightings.points], minlength=len(frames))[
        held
    ]
    shares: Float64[np.ndarray, " h"] = np.where(
        counts >= FEW_POINTS, common / np.maximum(counts, 1), beside
    )
    return shares


def _centers_and_axes(
    frames: Sequence[Frame],
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3"]]:
    """Positions of the cameras in the world, and the directions in which they look."""
    poses = torch.stack([frame.world_to_camera for frame in frames]).double().numpy()
    rotations, translations = poses[:, :3, :3], poses[:, :3, 3]
    return -np.einsum("nji,nj->ni", rotations, translations), rotations[:, 2]
