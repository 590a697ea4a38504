"""Growth limit: the largest number of Gaussians that the settings of a run allow."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

LIMITS = ("strategy.max_gaussians", "strategy.cap_max")
"""Keys of numbers of Gaussians; 0 or absent: no limit."""
PER_PIXEL = "strategy.per_pixel"
"""Key of the number of Gaussians for each pixel of a view at which growth ends."""
UNLIMITED = 1 << 62
"""Gaussians of a strategy without a limit."""


def most_gaussians(settings: Mapping[str, Any], view_pixels: int, start: int) -> int:
    """The limit of a run; ``UNLIMITED`` where there is none.

    Args:
        settings: of the run, by dotted key.
        view_pixels: pixels of a training view; 0 if unknown.
        start: rows that the model has, of which a number for each pixel takes none away.
    """
    limits = [int(settings.get(key) or 0) for key in LIMITS]
    if settings.get(PER_PIXEL) and view_pixels:
        limits.append(max(int(float(settings[PER_PIXEL]) * view_pixels), start))
    return min([limit for limit in limits if limit], default=UNLIMITED)
