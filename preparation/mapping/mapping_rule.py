"""MappingRule: how camera poses are computed."""

from __future__ import annotations

from dataclasses import dataclass

from gsfw.core.errors import ConfigError

MAPPERS = ("incremental", "global")


@dataclass(frozen=True)
class MappingRule:
    """The user's choices."""

    mapper: str = "incremental"
    """"incremental" (COLMAP: image after image) or "global" (GLOMAP: all at once)."""
    refine_focal: bool = True
    """True if focal lengths are computed, or stay as they were given."""
    refine_principal_point: bool = False
    """True if principal points are computed, or stay in the middle of the image."""
    jobs: int = 1
    """Number of threads."""
    thorough: bool = False
    """True to adjust a growing model as often as COLMAP does by default."""

    def check(self) -> None:
        """Check the values.

        Raises:
            ConfigError: one of them makes no sense.
        """
        if self.mapper not in MAPPERS:
            raise ConfigError(f"mapper={self.mapper}: expected one of {', '.join(MAPPERS)}.")
        if self.jobs < 1:
            raise ConfigError(f"jobs={self.jobs}: expected at least 1.")
