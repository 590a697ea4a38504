"""Reducer: where several processes will meet."""

from __future__ import annotations

from collections.abc import Iterable

from torch import Tensor


class Reducer:
    """What happens to losses and gradients between backward and the optimizer: nothing, alone."""

    @property
    def world_size(self) -> int:
        """Number of processes that train together."""
        return 1

    def gradients_(self, gradients: Iterable[Tensor]) -> None:
        """Average over processes, in place."""

    def loss(self, loss: Tensor) -> Tensor:
        """Average over processes."""
        return loss
