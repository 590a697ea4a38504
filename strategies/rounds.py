"""Rounds: refinement every so many steps, with row statistics gathered in between."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.model import DensifiableModel
from gsfw.core.refinement.row_statistics import RowStatistics
from gsfw.core.refiner import Refiner
from gsfw.core.render_output import RenderStatistics
from gsfw.core.table import SplatTable

COPIES = 2
"""Number of children of a split row (Kerbl et al. 2023, section 5.2)."""


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

    def nears(self, step: int, steps: int) -> bool:
        """True if ``step`` is one of the last ``steps`` before a round."""
        left = -(step + 1) % self.every
        return left < steps and self.due(step + 1 + left)

    def progress(self, done: int) -> float:
        """Fraction of all rounds that are over with the one after ``done`` steps, in [0, 1]."""
        before, last = self.start // self.every, (self.stop - 1) // self.every
        return (done // self.every - before) / max(last - before, 1)


class DensityRefiner(Refiner):
    """A refiner that adds rows in rounds, by the row statistics since the last change of rows."""

    def __init__(self, rounds: RefinementRounds) -> None:
        self._rounds = rounds
        self._seen: RowStatistics | None = None

    def growth_due(self, step: int) -> bool:
        """True before each round."""
        return self._rounds.due(step + 1)

    def gather(
        self,
        context: StepContext,
        statistics: RenderStatistics,
        gradient: Float[Tensor, "c m"] | None,
    ) -> RowStatistics | None:
        """Add up gradients and radii of a batch by row; ``None`` where none are needed.

        Args:
            context: context of the batch.
            statistics: statistics of the batch.
            gradient: the one of its gradients that rows are ranked by; ``None`` if not measured.
        """
        if gradient is None or not self.statistics(context.step):
            return None
        if self._seen is None:
            self._seen = RowStatistics(context.num_rows, gradient.device)
        self._seen.add(context, statistics, gradient)
        return self._seen

    @property
    def growth_ends(self) -> int:
        """The end of the rounds."""
        return self._rounds.stop

    def rows_edited(self) -> None:
        """Drop the statistics after a change of rows."""
        self._seen = None

    @staticmethod
    def prune(table: SplatTable, model: DensifiableModel, kept: Bool[Tensor, " n"]) -> int:
        """Remove all rows but these, and return how many; the most opaque row stays in any case.

        Training needs at least one row.
        """
        if len(kept) and not bool(kept.any()):
            kept = kept.index_fill(0, model.opacities().argmax(), True)
        pruned = len(kept) - int(kept.sum())
        if pruned:
            table.keep(kept)
        return pruned

    def state_dict(self) -> dict[str, Any]:
        """The sums since the last change of rows; none if nothing is gathered."""
        return {"gathered": {} if self._seen is None else self._seen.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``."""
        gathered = state.get("gathered", {})
        device = gathered["views"].device if gathered else None
        self._seen = None if device is None else RowStatistics.restored(gathered, device)
