"""Sampler: the order of the training views, and the schedule of time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

from jaxtyping import Float
from torch import Tensor


class Sampler(ABC):
    """The order of the training views, and the schedule of time.

    Its state is the *consumed* position: ``peek`` (for prefetching) never changes it.
    """

    is_schedule: ClassVar[bool] = False
    """True if the order depends on the step of the run, as of times that follow each other. A run
    that takes several updates for one step then has the views of that step in all of them."""

    @abstractmethod
    def next(self) -> tuple[int, ...]:
        """The training views of this step; they may form several batches."""

    @abstractmethod
    def peek(self, count: int) -> tuple[int, ...]:
        """The next ``count`` views as far as they are known; a hint for prefetching."""

    def observe(self, views: tuple[int, ...], losses: Float[Tensor, " c"]) -> None:  # noqa: B027
        """Receive the losses of the latest views (for error-weighted sampling); ignored by default.

        Each view of a batch has the batch's mean loss; after a step that was not finite it is 0.
        """

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Tensors and plain data."""

    @abstractmethod
    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``."""
