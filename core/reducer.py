"""Reducer: the interface for training with several processes."""

from __future__ import annotations

from collections.abc import Iterable

from jaxtyping import Bool
from torch import Tensor

from gsfw.core.render_output import RenderStatistics


class Reducer:
    """Reduces losses and gradients between backward and the optimizer; no-op for one process."""

    @property
    def world_size(self) -> int:
        """Number of processes of the training."""
        return 1

    def gradients_(self, gradients: Iterable[Tensor]) -> None:
        """Average gradients over processes, in place."""

    def statistics(self, statistics: RenderStatistics) -> RenderStatistics:
        """Combine the statistics of all processes, so that strategies decide alike in each."""
        return statistics

    def visible(self, visible: Bool[Tensor, " n"]) -> Bool[Tensor, " n"]:
        """Rows that any process has seen."""
        return visible

    def loss(self, loss: Tensor) -> Tensor:
        """Average the loss over processes."""
        return loss
