"""TrackExposure: how images differ in exposure and white balance, by the points they share.

A channel of point p in image v is gain_v m_p + offset_v. As in Park et al. 2016 ("Efficient and
Robust Color Consistency for Community Photo Collections"), what all images and points have in
common is found at once from the matches of a reconstruction, and robustly. We differ in the model
(an offset in place of their gamma), in the solver (alternating lines and means under Huber's
weights), and in that the mean exposure is held at the identity, as a training with exposure=true
holds it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

ROUNDS = 20
"""Alternations: twice as many move the deviations that are left of fox by 0.0002 grey levels."""
HUBER = 1.345
"""Standard deviations from which on a residual counts less (95 % efficiency, Huber 1964)."""
MAD = 1.4826
"""Standard deviation of normal residuals, in medians of their absolute values."""
FEWEST = 30
"""Observations in an image below which its exposure is left as it is."""
READABLE = (0.02, 0.98)
"""Values outside may be clipped, and say nothing of exposure."""
USUAL = (1 / 8, 8.0)
"""Gains outside are none: an image of one colour, such as fog or a lens cap, has 0."""


@dataclass(frozen=True)
class TrackExposure:
    """The exposure of ``v`` images; the mean of all that are known is the identity."""

    gains: Float[np.ndarray, "v 3"]
    offsets: Float[np.ndarray, "v 3"]

    @staticmethod
    def of(
        points: Int[np.ndarray, " o"],
        views: Int[np.ndarray, " o"],
        colors: Float[np.ndarray, "o 3"],
    ) -> TrackExposure:
        """From the colours of points in views."""
        count = int(views.max(initial=-1)) + 1
        lines = [_channel(points, views, values, count) for values in colors.T]
        gains, offsets = (np.stack(parts, axis=1) for parts in zip(*lines, strict=True))
        return TrackExposure(gains, offsets)

    def removed(
        self, colors: Float[np.ndarray, "o 3"], views: Int[np.ndarray, " o"]
    ) -> Float[np.ndarray, "o 3"]:
        """The colours as the mean exposure would have them."""
        return (colors - self.offsets[views]) / self.gains[views]


def _channel(
    points: Int[np.ndarray, " o"],
    views: Int[np.ndarray, " o"],
    values: Float[np.ndarray, " o"],
    count: int,
) -> tuple[Float[np.ndarray, " v"], Float[np.ndarray, " v"]]:
    """Gains and offsets of one channel."""
    readable = (values > READABLE[0]) & (values < READABLE[1])
    points, views, values = points[readable], views[readable], values[readable]
    known = np.bincount(views, minlength=count) >= FEWEST
    gains, offsets, weights = np.ones(count), np.zeros(count), np.ones(len(values))
    for _ in range(ROUNDS):
        even = (values - offsets[views]) / gains[views]
        weight = np.maximum(np.bincount(points, weights), 1e-12)
        means = (np.bincount(points, weights * even) / weight)[points]
        slopes, heights = _lines(views, means, values, weights, count)
        known &= (slopes > USUAL[0]) & (slopes < USUAL[1])
        gains[~known], offsets[~known] = 1.0, 0.0
        if not known.any():
            return gains, offsets
        # Points of another mean exposure explain the same values.
        scale, shift = slopes[known].mean(), heights[known].mean()
        gains[known] = slopes[known] / scale
        offsets[known] = heights[known] - gains[known] * shift
        means = scale * means + shift
        off = np.abs(values - gains[views] * means - offsets[views])
        weights = np.minimum(1.0, HUBER * MAD * np.median(off) / np.maximum(off, 1e-12))
    return gains, offsets


def _lines(
    views: Int[np.ndarray, " o"],
    means: Float[np.ndarray, " o"],
    values: Float[np.ndarray, " o"],
    weights: Float[np.ndarray, " o"],
    count: int,
) -> tuple[Float[np.ndarray, " v"], Float[np.ndarray, " v"]]:
    """Fit a line from means to values for each view, by weighted least squares."""
    total, x, y, xx, xy = (
        np.bincount(views, weights * part, minlength=count)
        for part in (np.ones_like(means), means, values, means * means, means * values)
    )
    slopes = (total * xy - x * y) / np.maximum(total * xx - x * x, 1e-12)
    return slopes, (y - slopes * x) / np.maximum(total, 1e-12)
