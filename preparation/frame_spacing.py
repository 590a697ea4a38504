"""Spacing: which images of a moving camera to take, sharp ones at equal changes of the view."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float, Int

NEAREST = 0.005
"""Least change of the view between two chosen images, of the longer side: 10 pixels of a
image of 1920, and a degree or two of the way around an object."""
LONGEST = 4.0
"""No two chosen images follow each other at more than so many times the average interval, where
the view changes enough in it: a camera that comes nearer changes its view slowly."""
OFF_CENTER = 0.5
"""Part of its worth that an image loses at the edge of its window: an image twice as sharp is
taken from there, a slightly sharper one is not."""
HALVINGS = 24
"""Number of halvings of the range in which the width of windows is searched."""


def spaced(
    positions: Float[np.ndarray, " n"],
    times: Float[np.ndarray, " n"],
    sharpness: Float[np.ndarray, " n"],
    usable: Bool[np.ndarray, " n"],
    count: int,
) -> Int[np.ndarray, " chosen"]:
    """Indices of at most ``count`` images, ascending; fewer where the view changes too little.

    The path of the view is cut into windows of equal length, and the sharpest image is taken
    from each; the length is the one that gives as many as are asked for.

    Args:
        positions: how far the view has come, never falling, of the longer side.
        times: in seconds, ascending.
        sharpness: 0 or more; compared within windows only.
        usable: which may be taken; at least one.
        count: at least 1.
    """
    places = np.flatnonzero(usable)
    path = _Path(positions[places], times[places], sharpness[places], count)
    chosen = path.choose(NEAREST)
    narrow, wide = NEAREST, 1.01 * max(NEAREST, path.length)
    if len(chosen) > count:
        chosen = path.choose(wide)
        for _ in range(HALVINGS):
            middle = math.sqrt(narrow * wide)
            found = path.choose(middle)
            if len(found) > count:
                narrow = middle
            else:
                wide = middle
                # The narrowest that gives as many: the last window is then as wide as the others.
                chosen = max(found, chosen, key=len)
    return places[chosen]


class _Path:
    """The images that may be taken, along the path of the view."""

    def __init__(
        self,
        positions: Float[np.ndarray, " n"],
        times: Float[np.ndarray, " n"],
        sharpness: Float[np.ndarray, " n"],
        count: int,
    ) -> None:
        self._positions, self._times, self._sharpness = positions, times, sharpness
        self.length = float(positions[-1] - positions[0])
        self._longest = LONGEST * float(times[-1] - times[0]) / count

    def choose(self, width: float) -> list[int]:
        """The best image of each window, none too near to the one before."""
        chosen: list[int] = []
        start, edge = 0, self._positions[0]
        while start < len(self._positions):
            # Windows lie at multiples of their width, so that rounding to images adds up to none.
            edge += width * ((self._positions[start] - edge) // width)
            end = max(start + 1, int(np.searchsorted(self._positions, edge + width)))
            if (late := self._late(start)) < end:
                end, edge = late, self._positions[late]
            first = start
            if chosen:
                nearest = self._positions[chosen[-1]] + NEAREST
                first = max(first, int(np.searchsorted(self._positions, nearest)))
            if first < end:
                chosen.append(first + int(self._worth(start, end)[first - start :].argmax()))
            start = end
        return chosen

    def _late(self, start: int) -> int:
        """The image at which a window that begins with ``start`` has lasted long enough."""
        return int(
            max(
                np.searchsorted(self._positions, self._positions[start] + 2 * NEAREST),
                np.searchsorted(self._times, self._times[start] + self._longest),
                start + 1,
            )
        )

    def _worth(self, start: int, end: int) -> Float[np.ndarray, " window"]:
        """Weights of the images of a window: sharpness, reduced towards its edges."""
        positions = self._positions[start:end]
        middle, half = (positions[0] + positions[-1]) / 2, (positions[-1] - positions[0]) / 2
        off = (positions - middle) / half if half > 0 else np.zeros_like(positions)
        return np.asarray(self._sharpness[start:end] * (1 - OFF_CENTER * off**2))
