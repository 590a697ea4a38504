"""Reducer: where several processes will meet."""

from __future__ import annotations

from collections.abc import Iterable

from jaxtyping import Bool
from torch import Tensor

from gsfw.core.render_output import RenderStatistics


class Reducer:
    """What happens to losses and gradients between backward and the optimizer: nothing, alone."""

    @property
    def world_size(self) -> int:
        """Number of processes that train together."""
        return 1

    def gradients_(self, gradients: Iterable[Tensor]) -> None:
        """Average over processes, in place."""

    def statistics(self, statistics: RenderStatistics) -> RenderStatistics:
        """What all processes have measured, so that strategies decide alike everywhere."""
        return statistics

    def visible(self, visible: Bool[Tensor, " n"]) -> Bool[Tensor, " n"]:
        """Rows that any process saw."""
        return visible

    def loss(self, loss: Tensor) -> Tensor:
        """Average over processes."""
        return loss
