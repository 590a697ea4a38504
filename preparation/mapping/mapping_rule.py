"""MappingRule: how camera poses are computed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class MappingRule:
    """The user's choices."""

    mapper: Literal["incremental", "global"] = "incremental"
    """COLMAP (image after image) or GLOMAP (all at once)."""
    refine_focal: bool = True
    """True if focal lengths are computed, or stay as they were given."""
    refine_principal_point: bool = False
    """True if principal points are computed, or stay in the middle of the image."""
    known_cameras: tuple[int, ...] = ()
    """Numbers of the cameras that stay as they were given, whatever the others do."""
    jobs: int = 1
    """Number of threads."""
    thorough: bool = False
    """True to adjust a growing model as often as COLMAP does by default."""
