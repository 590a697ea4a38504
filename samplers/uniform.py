"""Sampler uniform: every view once per epoch, in random order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gsfw.core.config import SamplerConfig
from gsfw.core.datamanager import Views
from gsfw.core.ranges import number
from gsfw.core.sampler import Sampler
from gsfw.samplers.order import item_at


@dataclass
class UniformConfig(SamplerConfig):
    """Every view once per epoch."""

    views_per_step: int = number(1, at_least=1)
    """Views per step; their gradients are averaged."""

    def build(self, views: Views, seed: int, steps: int) -> Sampler:
        """Build the sampler."""
        return UniformSampler(len(views), self.views_per_step, seed)


class UniformSampler(Sampler):
    """An endless sequence of epochs, each a permutation of all views, cut into steps."""

    def __init__(self, num_views: int, views_per_step: int, seed: int) -> None:
        self._views = range(num_views)
        self._views_per_step = views_per_step
        self._seed = seed
        self._position = 0

    def next(self) -> tuple[int, ...]:
        """The next ``views_per_step`` views; a step may reach into the next epoch."""
        views = self.peek(self._views_per_step)
        self._position += self._views_per_step
        return views

    def peek(self, count: int) -> tuple[int, ...]:
        """The next ``count`` views, exactly."""
        positions = range(self._position, self._position + count)
        return tuple(item_at(position, self._views, self._seed) for position in positions)

    def state_dict(self) -> dict[str, Any]:
        """Number of sampled views."""
        return {"position": self._position}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue after the sampled views."""
        self._position = state["position"]
