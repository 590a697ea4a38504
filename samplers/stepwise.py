"""StepwiseSampler: base class of samplers whose steps are functions of their number."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

from gsfw.core.sampler import Sampler


class StepwiseSampler(Sampler):
    """Its state is the number of finished steps; previews are exact."""

    def __init__(self) -> None:
        self._position = 0

    @abstractmethod
    def step(self, position: int) -> tuple[int, ...]:
        """The views of a step (counted from 0), at least one."""

    def next(self) -> tuple[int, ...]:
        """The views of the next step."""
        views = self.step(self._position)
        self._position += 1
        return views

    def peek(self, count: int) -> tuple[int, ...]:
        """The next ``count`` views, exactly."""
        found: list[int] = []
        position = self._position
        while len(found) < count:
            found += self.step(position)
            position += 1
        return tuple(found[:count])

    def state_dict(self) -> dict[str, Any]:
        """Number of finished steps."""
        return {"position": self._position}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue after the finished steps."""
        self._position = state["position"]
