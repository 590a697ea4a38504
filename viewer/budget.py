"""FrameBudget: the size of frames while a page moves, so that each takes no longer than allowed."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

LEAST_SCALE = 0.2
"""Least side of a moving frame, relative to that at rest; below, nothing is recognised."""
RECENT = 16
"""Measured frames that the model of their duration is fitted to."""


class FrameBudget:
    """Predicts the duration of a frame from those before: a fixed part, and a part per pixel.

    The fixed part (projection and sorting of all Gaussians) does not shrink with the image. Where
    it alone exceeds the budget, frames are as large as makes them take twice as long as it: much
    smaller ones would be ugly and hardly faster.
    """

    def __init__(self) -> None:
        self._pixels: deque[float] = deque(maxlen=RECENT)
        self._seconds: deque[float] = deque(maxlen=RECENT)

    def observe(self, pixels: int, seconds: float) -> None:
        """Learn from a frame of ``pixels`` that took ``seconds``."""
        self._pixels.append(pixels)
        self._seconds.append(seconds)

    def scale(self, full_pixels: int, seconds: float) -> float:
        """Side of a frame that takes ``seconds``, relative to a full one; in [LEAST_SCALE, 1].

        Args:
            full_pixels: pixels of a frame at rest.
            seconds: the budget.
        """
        fixed, per_pixel = self.model()
        room = seconds - fixed if seconds > 2 * fixed else fixed
        if per_pixel <= 0 or room <= 0:
            return 1.0 if self._pixels and max(self._seconds) <= seconds else 0.5
        affordable = room / per_pixel
        return min(max(math.sqrt(affordable / full_pixels), LEAST_SCALE), 1.0)

    def model(self) -> tuple[float, float]:
        """Seconds of the fixed part, and seconds per pixel; both 0 before any frame."""
        if not self._pixels:
            return 0.0, 0.0
        pixels, seconds = np.asarray(self._pixels), np.asarray(self._seconds)
        mean_pixels, mean_seconds = float(pixels.mean()), float(seconds.mean())
        varied = float(((pixels - mean_pixels) ** 2).sum())
        if varied < 1e-3 * mean_pixels**2 * len(pixels):  # One size alone says no slope.
            return 0.0, mean_seconds / mean_pixels
        slope = float(((pixels - mean_pixels) * (seconds - mean_seconds)).sum()) / varied
        slope = max(slope, 0.0)
        fixed = mean_seconds - slope * mean_pixels
        if fixed < 0:
            return 0.0, mean_seconds / mean_pixels
        return fixed, slope
