"""Variant: one way to give something up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gsfw.studies.tradeoff.subject import Subject

AS_IS = "as it is"
"""Axis, and name, of the model with nothing given up."""

AXES = (
    *("sh", "prune", "time", "precision", "format", "cutoffs"),
    *("antialias", "resolution", "backend", "combined"),
)
"""What can be given up, in the order in which it is shown."""

STORAGE = (AS_IS, "sh", "prune", "time", "precision", "format", "combined")
"""Axes along which size may change; all others only change how the same is drawn."""


@dataclass(frozen=True)
class Variant:
    """One way to give something up."""

    axis: str
    name: str
    change: Callable[[Subject], Subject]
    """From the model as it is to the one that is measured; may take its time."""
    command: tuple[str, ...] = ()
    """Verb and settings that do the same to a run; empty where no verb does."""
    draws_alike: bool = False
    """Whether as much is drawn as of the model as it is: only storage differs, and no time is
    measured."""
    file: str = ""
    """Format of the file that ``command`` writes; empty for none."""

    @property
    def key(self) -> tuple[str, str]:
        """By which its figures are found again."""
        return self.axis, self.name


def unchanged(subject: Subject) -> Subject:
    """The model as it is."""
    return subject
