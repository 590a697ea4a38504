"""Sampler my-part: views at random, and by their latest loss."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from gsfw.api import Sampler, SamplerConfig, Views, number
from torch import Tensor


@dataclass
class MyPartConfig(SamplerConfig):
    """Settings of sampler my-part."""

    random_share: float = number(0.5, at_least=0, at_most=1)
    """Part of the steps whose view is chosen with no regard to losses."""

    def build(self, views: Views, seed: int, steps: int) -> Sampler:
        """Build the sampler of the training views."""
        return MyPart(len(views), seed, self.random_share)


class MyPart(Sampler):
    """One view per step. Views that have not been seen come first, in random order.

    Each step has a generator of its own, seeded by the run's seed and the step, so that position
    and losses are the whole state.
    """

    def __init__(self, num_views: int, seed: int, random_share: float) -> None:
        self._num_views, self._seed, self._random_share = num_views, seed, random_share
        self._position = 0
        self._losses = torch.zeros(num_views)

    def next(self) -> tuple[int, ...]:
        """The view of this step."""
        view = self._view_at(self._position)
        self._position += 1
        return (view,)

    def peek(self, count: int) -> tuple[int, ...]:
        """The next views if no loss changed; a hint, for decoding ahead."""
        return tuple(self._view_at(self._position + ahead) for ahead in range(count))

    def _view_at(self, position: int) -> int:
        if position < self._num_views:
            generator = torch.Generator().manual_seed(self._seed)
            return int(torch.randperm(self._num_views, generator=generator)[position])
        generator = torch.Generator().manual_seed((self._seed + 7919 * position) % 2**63)
        weights = self._losses
        by_chance = float(torch.rand((), generator=generator)) < self._random_share
        if by_chance or float(weights.sum()) <= 0:
            weights = torch.ones(self._num_views)
        return int(torch.multinomial(weights, 1, generator=generator))

    def observe(self, views: tuple[int, ...], losses: Tensor) -> None:
        """Keep the losses of the latest views; 0 stands for a step that was not finite."""
        for view, loss in zip(views, losses.tolist(), strict=True):
            if loss > 0:
                self._losses[view] = loss

    def state_dict(self) -> dict[str, Any]:
        """Number of finished steps, and the loss of each view (0: not seen)."""
        return {"position": self._position, "losses": self._losses}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``."""
        self._position = state["position"]
        self._losses = state["losses"].cpu().clone()
