"""Sampler: which views come next, and when time advances."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

from jaxtyping import Float
from torch import Tensor


class Sampler(ABC):
    """Which views come next, and when time advances.

    Its state is the position *consumed*: looking ahead (for prefetching) never changes it.
    """

    @abstractmethod
    def next(self) -> tuple[int, ...]:
        """The training views of this step; they may fall into several batches."""

    @abstractmethod
    def peek(self, count: int) -> tuple[int, ...]:
        """The next ``count`` views as far as is known now; a hint for prefetching."""

    def observe(self, views: tuple[int, ...], losses: Float[Tensor, " c"]) -> None:  # noqa: B027
        """Take note of the loss of views just drawn (error-weighted sampling); no default use.

        Views that share a batch are given its mean loss; a step that was not finite has 0.
        """

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Tensors and plain data."""

    @abstractmethod
    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``."""
