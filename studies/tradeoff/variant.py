"""Variant: one change of a finished model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gsfw.studies.tradeoff.subject import Subject

AS_IS = "as it is"
"""Axis and name of the unchanged model."""

AXES = (
    *("sh", "prune", "time", "precision", "format", "cutoffs"),
    *("antialias", "resolution", "backend", "combined"),
)
"""Axes of change, in the order of tables."""

STORAGE = (AS_IS, "sh", "prune", "time", "precision", "format", "combined")
"""Axes along which the size may change; all others change only the rendering."""


@dataclass(frozen=True)
class Variant:
    """One change of a finished model."""

    axis: str
    name: str
    change: Callable[[Subject], Subject]
    """Makes the variant from the unchanged model; may be slow."""
    command: tuple[str, ...] = ()
    """Verb and settings that do the same to a run; empty where no verb does."""
    draws_alike: bool = False
    """True if rendering is as fast as that of the unchanged model: only the storage differs, and no
    time is measured."""
    file: str = ""
    """Format of the file that ``command`` writes; empty for none."""

    @property
    def key(self) -> tuple[str, str]:
        """Axis and name."""
        return self.axis, self.name


def unchanged(subject: Subject) -> Subject:
    """The unchanged model."""
    return subject
