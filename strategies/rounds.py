"""RefinementRounds: the steps after which rows are edited."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RefinementRounds:
    """Regular steps after one step and before another."""

    start: int
    """No round up to this step."""
    every: int
    """Steps between rounds."""
    stop: int
    """No round from this step on."""

    def due(self, done: int) -> bool:
        """True if a round is due after ``done`` steps."""
        return self.start < done < self.stop and done % self.every == 0
