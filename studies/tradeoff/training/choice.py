"""Choice: one value on one axis of what a run may give up before it is trained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

BASELINE = "baseline"
"""Name of the run with nothing given up."""


@dataclass(frozen=True)
class Choice:
    """One value on one axis."""

    axis: str
    name: str
    """As tables have it."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Of the run, by dotted key."""
    part: float | None = None
    """Of the baseline's Gaussians, that the run may have at most; ``None`` for no limit."""


@dataclass(frozen=True)
class Recipe:
    """Choices on different axes that are made together; none for the baseline."""

    choices: tuple[Choice, ...] = ()

    @property
    def name(self) -> str:
        """As tables have it."""
        return " + ".join(choice.name for choice in self.choices) or BASELINE

    @property
    def part(self) -> float | None:
        """Of the baseline's Gaussians; ``None`` where they need not be known."""
        return min((c.part for c in self.choices if c.part is not None), default=None)

    @property
    def settings(self) -> dict[str, Any]:
        """What it changes, but for the limit of Gaussians."""
        return {key: value for choice in self.choices for key, value in choice.settings.items()}
