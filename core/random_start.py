"""Random start: how many Gaussians a capture without points begins with."""

from __future__ import annotations

PIXELS_PER_POINT = 4
"""Pixels of a view for each point. With many more points, runs end while density control still
removes them: 200 steps of chair at 100 x 100 come to 19.4 dB from 5000 points and to 15.6 from
20,000, and 500 steps of NeRF-synthetic to 24.1 dB from 10,000 and to 15.9 from 100,000."""

FEWEST, MOST = 5_000, 100_000
"""Points at least, and at most: Kerbl et al. 2023's number for NeRF-synthetic."""

LEAST_PIXELS_PER_POINT = 2
"""Pixels of a view for each point of the fewest: thumbnails have no use for 5000."""


def random_count(view_pixels: int) -> int:
    """Number of random points that views of ``view_pixels`` can use; 0: their size is unknown."""
    if view_pixels <= 0:
        return MOST
    fewest = min(FEWEST, view_pixels / LEAST_PIXELS_PER_POINT)
    return max(1, int(min(max(view_pixels / PIXELS_PER_POINT, fewest), MOST)))
