"""Rounds: refinement every so many steps, with row statistics gathered in between."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gsfw.core.refinement.row_statistics import RowStatistics
from gsfw.core.refiner import Refiner


@dataclass(frozen=True)
class RefinementRounds:
    """Every so many steps, after one step and before another."""

    start: int
    """No round up to this step."""
    every: int
    """Steps between rounds."""
    stop: int
    """No round from this step on."""

    def due(self, done: int) -> bool:
        """True if there is a round after ``done`` steps."""
        return self.start < done < self.stop and done % self.every == 0


class DensityRefiner(Refiner):
    """A refiner that adds rows in rounds, by the row statistics since the last change of rows."""

    def __init__(self, rounds: RefinementRounds) -> None:
        self._rounds = rounds
        self._seen: RowStatistics | None = None

    def growth_due(self, step: int) -> bool:
        """True before each round."""
        return self._rounds.due(step + 1)

    @property
    def growth_ends(self) -> int:
        """The end of the rounds."""
        return self._rounds.stop

    def rows_edited(self) -> None:
        """Drop the statistics after a change of rows."""
        self._seen = None

    def state_dict(self) -> dict[str, Any]:
        """The sums since the last change of rows; none if nothing is gathered."""
        return {"gathered": {} if self._seen is None else self._seen.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``."""
        gathered = state.get("gathered", {})
        device = gathered["views"].device if gathered else None
        self._seen = None if device is None else RowStatistics.restored(gathered, device)
