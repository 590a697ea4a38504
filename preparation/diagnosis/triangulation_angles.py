"""Triangulation angles: within how wide an angle each point is seen."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from gsfw.preparation.mapping.observations import Observations

AT_ONCE = 4_000_000
"""Pairs of rays whose angles are in memory together: 32 MB."""


def widest_angles(
    seen: Observations, centers: Float64[np.ndarray, "r 3"]
) -> Float64[np.ndarray, " p"]:
    """The widest angle between any two rays to each point, in degrees; 0 where nothing sees it.

    Args:
        seen: which picture sees which point.
        centers: where the pictures were taken from.
    """
    rays = centers[seen.pictures] - seen.positions[seen.points]
    norms = np.linalg.norm(rays, axis=1, keepdims=True)
    rays = rays / np.maximum(norms, np.finfo(np.float64).tiny)
    starts = np.cumsum(seen.lengths) - seen.lengths
    angles = np.zeros(len(seen.positions))
    # Points that equally many pictures see make one array, without gaps.
    for length in np.unique(seen.lengths[seen.lengths > 0]).tolist():
        chosen = np.flatnonzero(seen.lengths == length)
        for part in np.array_split(chosen, 1 + len(chosen) * length**2 // AT_ONCE):
            tracks = rays[starts[part, None] + np.arange(length)]
            cosines = (tracks @ tracks.transpose(0, 2, 1)).min(axis=(1, 2))
            angles[part] = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    return angles
