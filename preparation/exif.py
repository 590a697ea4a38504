"""Exif: what a photo says of the camera that took it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Exif:
    """Empty strings and ``None`` where the file says nothing."""

    make: str = ""
    model: str = ""
    lens: str = ""
    focal_mm: float | None = None
    """Focal length in millimetres."""
    focal_35mm: float | None = None
    """The focal length that would show as much on 36x24 mm film, in millimetres."""
    exposure_seconds: float | None = None
    taken: str = ""
    """When, as "YYYY:MM:DD HH:MM:SS"."""
