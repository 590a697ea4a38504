"""Sightings: which pictures show which points, as the reconstruction matched them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64


@dataclass(frozen=True)
class Sightings:
    """``o`` pairs of a point and a picture of a recording, each at most once."""

    points: Int64[np.ndarray, " o"]
    """Rows among the points; ascending."""
    frames: Int64[np.ndarray, " o"]
    """Rows among the frames."""
    errors: Float64[np.ndarray, " p"]
    """Of each point, the mean distance in pixels between where it was matched and where it is
    projected; of pictures of the size that was reconstructed from."""

    @staticmethod
    def none() -> Sightings:
        """Of a data set that has no points."""
        nothing = np.zeros(0, np.int64)
        return Sightings(nothing, nothing, np.zeros(0))
