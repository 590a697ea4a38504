"""Sampler error-weighted: samples views with a large loss more often.

A view's share of an epoch is its running mean loss over the sum of all, mixed with a uniform share
so that every view is sampled. Losses stay on the device and are read once per epoch, so that no
step waits for a GPU; the epoch's samples are fixed then. Systematic sampling: a view with the
expected count x is sampled floor(x) or ceil(x) times, and equal losses give an ordinary epoch.

Samples are not reweighted: the objective is the mean loss in which a view is weighted by its error,
as in hard-example mining. Weights of 1 / probability would restore the plain mean, with a lower
variance, and would improve the fit of no view.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.config import SamplerConfig
from gsfw.core.datamanager import Views
from gsfw.core.ranges import number
from gsfw.core.sampler import Sampler
from gsfw.samplers.order import epoch_generator


@dataclass
class ErrorWeightedConfig(SamplerConfig):
    """Views in proportion to their loss."""

    uniform_share: float = number(0.3, at_least=0, at_most=1)
    """Fraction of the samples that is shared evenly among all views, in [0, 1]; 1: uniform."""
    memory: float = number(0.7, at_least=0, below=1)
    """Weight of a view's earlier mean loss when it is seen again, in [0, 1)."""
    views_per_step: int = number(1, at_least=1)
    """Views per step; their gradients are averaged, and those of one batch share its loss."""

    def build(self, views: Views, seed: int, steps: int) -> Sampler:
        """Build the sampler."""
        return ErrorWeightedSampler(len(views), self, seed)


class ErrorWeightedSampler(Sampler):
    """Epochs of about as many samples as views, from the losses known at their start."""

    def __init__(self, num_views: int, config: ErrorWeightedConfig, seed: int) -> None:
        self._config = config
        self._num_views = num_views
        self._seed = seed
        self._steps_per_epoch = -(-num_views // config.views_per_step)
        self._position = 0
        self._losses: Float[Tensor, " n"] | None = None
        """Running mean losses on the device; 0 for a view that was not seen."""
        self._shares = torch.full((num_views,), 1.0 / num_views, dtype=torch.float64)
        """Share of each view in the current epoch; on the host."""
        self._order: tuple[int, ...] = ()
        """The samples of the current epoch."""

    def next(self) -> tuple[int, ...]:
        """The next ``views_per_step`` views; each epoch starts by reading the losses."""
        epoch, within = divmod(self._position, self._steps_per_epoch)
        if within == 0:
            self._shares = self._known_shares()
            self._order = self._draws(epoch)
        self._position += 1
        start = within * self._config.views_per_step
        return self._order[start : start + self._config.views_per_step]

    def peek(self, count: int) -> tuple[int, ...]:
        """The next views: exact within the epoch, and with unchanged losses beyond."""
        epoch, within = divmod(self._position, self._steps_per_epoch)
        found = self._order[within * self._config.views_per_step :] if within else ()
        epoch += within > 0
        while len(found) < count:
            found += self._draws(epoch)
            epoch += 1
        return found[:count]

    def observe(self, views: tuple[int, ...], losses: Float[Tensor, " c"]) -> None:
        """Record losses on their device; a loss of 0 is that of a step that was not finite."""
        if self._losses is None:
            self._losses = losses.new_zeros(self._num_views)
        for view, loss in zip(views, losses, strict=True):
            known = self._losses[view]
            mean = torch.where(known > 0, loss.lerp(known, self._config.memory), loss)
            known.copy_(torch.where(loss > 0, mean, known))

    def _known_shares(self) -> Float[Tensor, " n"]:
        """Each view's share of the samples; unseen views have the mean of the others."""
        uniform = torch.full((self._num_views,), 1.0 / self._num_views, dtype=torch.float64)
        if self._losses is None:
            return uniform
        losses = self._losses.cpu().double()
        seen = losses > 0
        if not bool(seen.any()):
            return uniform
        losses = torch.where(seen, losses, losses[seen].mean())
        share = self._config.uniform_share
        return share * uniform + (1.0 - share) * losses / losses.sum()

    def _draws(self, epoch: int) -> tuple[int, ...]:
        """An epoch's views in random order, from the current shares; changes nothing."""
        generator = epoch_generator(self._seed, epoch)
        number = self._steps_per_epoch * self._config.views_per_step
        # Views lie in random order on a line, each as long as its share; the points that select
        # them are evenly spaced, so that rounding up is random.
        line = torch.randperm(self._num_views, generator=generator)
        ends = self._shares[line].cumsum(0)
        offset = torch.rand((), generator=generator, dtype=torch.float64)
        points = (torch.arange(number, dtype=torch.float64) + offset) / number * ends[-1]
        picked = torch.searchsorted(ends, points, right=True).clamp_max(self._num_views - 1)
        return tuple(line[picked][torch.randperm(number, generator=generator)].tolist())

    def state_dict(self) -> dict[str, Any]:
        """Number of finished steps, losses, and the inputs of the current epoch."""
        return {"position": self._position, "losses": self._losses, "shares": self._shares}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue in the middle of an epoch, with its original losses."""
        self._position = state["position"]
        losses = state["losses"]
        self._losses = None if losses is None else losses.clone()
        self._shares = state["shares"].cpu().clone()
        epoch, within = divmod(self._position, self._steps_per_epoch)
        self._order = self._draws(epoch) if within else ()
