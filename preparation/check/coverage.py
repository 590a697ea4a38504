"""Coverage: the sides from which cameras look at what they look at."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

ROUNDS = 20
"""Rounds of reweighting, after which the point hardly moves."""
AIMED = 20.0
"""Degrees from its axis within which a camera looks at a point."""
MOST = 0.9
"""Part of the cameras that has to look at the point; fewer do in a room, or along a street."""
STEEP = 75.0
"""Degrees above or below, from which on a camera looks from no side."""


def looked_at(
    centers: Float[np.ndarray, "s 3"], axes: Float[np.ndarray, "s 3"]
) -> Float[np.ndarray, " 3"] | None:
    """The point that is nearest to most of the cameras' axes; ``None`` if they share none.

    Least sum of distances, by weights: a few cameras that look elsewhere do not move it.
    """
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    weights = np.ones(len(axes))
    for _ in range(ROUNDS):
        total = (weights[:, None, None] * across).sum(0)
        right = (weights[:, None] * np.einsum("sij,sj->si", across, centers)).sum(0)
        point = np.linalg.pinv(total, rcond=1e-6) @ right
        missed = np.linalg.norm(np.einsum("sij,sj->si", across, point - centers), axis=1)
        weights = 1 / np.maximum(missed, 1e-3 * max(float(np.median(missed)), 1e-9))
    offsets = point - centers
    lengths = np.maximum(np.linalg.norm(offsets, axis=1), 1e-12)
    ahead = (offsets * axes).sum(1) / lengths > np.cos(np.radians(AIMED))
    return point if ahead.mean() >= MOST else None


def widest_gap(
    centers: Float[np.ndarray, "s 3"],
    middle: Float[np.ndarray, " 3"],
    up: Float[np.ndarray, " 3"],
) -> float:
    """Degrees of the largest sector around an axis through ``middle`` that has no camera."""
    offsets = centers - middle
    heights = offsets @ up
    level = offsets - heights[:, None] * up
    sides = np.linalg.norm(level, axis=1)
    level = level[np.degrees(np.arctan2(np.abs(heights), sides)) < STEEP]
    if len(level) < 2:
        return 0.0
    first = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    first /= np.linalg.norm(first)
    around = np.sort(np.arctan2(level @ np.cross(up, first), level @ first))
    gaps = np.diff(np.append(around, around[0] + 2 * np.pi))
    return float(np.degrees(gaps.max()))
