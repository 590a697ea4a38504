"""Deprecation: former names of the public interface, which still work, with a warning."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Deprecated:
    """A former name of the public interface."""

    replacement: str
    """The name that it now has."""
    since: str
    """First API version with the replacement."""
    removed: str
    """API version that has the former name no more."""

    def message(self, name: str) -> str:
        """The warning for a use of ``name``."""
        return (
            f"gsfw.api.{name} is now gsfw.api.{self.replacement}, since API version {self.since}; "
            f"version {self.removed} removes the former name."
        )


DEPRECATED = {"DensityStrategy": Deprecated("Refiner", since="1.0", removed="2.0")}
"""Former names; the first plugins derived their strategies from ``DensityStrategy``."""
