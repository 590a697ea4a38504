"""CameraGroup: pictures that one camera took with one lens setting, and so share parameters."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CameraGroup:
    """What is known of one camera before anything is computed."""

    number: int
    """Counted from 1; COLMAP's camera id."""
    model: str
    """One of COLMAP's camera models, such as SIMPLE_RADIAL."""
    width: int
    """Pixels of the upright pictures."""
    height: int
    focal: float
    """First guess, in pixels."""
    focal_origin: str
    """Where the guess comes from: "EXIF", "given", or "" for a usual one."""
    pictures: tuple[str, ...]
    """Names, in the order of the set."""
