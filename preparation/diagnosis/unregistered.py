"""Unregistered: an image that has no place in the model, and the cause of that."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

Reason = Literal[
    "does not decode",
    "too dark",
    "over-exposed",
    "empty",
    "few features",
    "motion blur",
    "blurred",
    "duplicate",
    "one view",
    "few matches",
    "matched only within its group",
    "matched, but not placed",
]
"""The reason why an image was not placed; causes before effects."""
MATCH_REASONS: frozenset[Reason] = frozenset(
    ("few matches", "matched only within its group", "matched, but not placed")
)
"""Reasons that a fault of the whole capture may cause, such as texture that repeats itself."""


@dataclass(frozen=True)
class Unregistered:
    """An image without a place, and why."""

    name: str
    path: Path
    reason: Reason
    found: str
    """A sentence with figures."""
    advice: str

    def document(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "name": self.name,
            "reason": self.reason,
            "found": self.found,
            "advice": self.advice,
        }
