"""Sampler same-time: several views of one time per step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gsfw.core.config import SamplerConfig
from gsfw.core.datamanager import Views
from gsfw.core.errors import ConfigError
from gsfw.core.ranges import number
from gsfw.core.sampler import Sampler
from gsfw.samplers.order import epoch_order
from gsfw.samplers.stepwise import StepwiseSampler
from gsfw.samplers.view_times import views_by_time


@dataclass
class SameTimeConfig(SamplerConfig):
    """Views of one time together, times in random order."""

    views_per_step: int = number(2, at_least=1)
    """Views per step, fewer if a time has no more left in this epoch."""

    def build(self, views: Views, seed: int, steps: int) -> Sampler:
        """Build the sampler.

        Raises:
            ConfigError: the views have no times, or no two share one.
        """
        by_time = views_by_time(views, "same-time")
        if len(by_time) == len(views):
            raise ConfigError(
                "sampler 'same-time': no two of the training views have the same time.",
                "Use sampler=uniform: one camera that moves has one view per time.",
            )
        return SameTimeSampler(list(by_time.values()), self.views_per_step, seed)


class SameTimeSampler(StepwiseSampler):
    """Every view once per epoch: the views of each time are shuffled and cut into steps."""

    def __init__(self, times: Sequence[Sequence[int]], views_per_step: int, seed: int) -> None:
        super().__init__()
        self._times = times
        self._views_per_step = views_per_step
        self._seed = seed
        self._steps = [
            (time, start)
            for time, views in enumerate(times)
            for start in range(0, len(views), views_per_step)
        ]

    def step(self, position: int) -> tuple[int, ...]:
        """Up to ``views_per_step`` views of one time."""
        epoch, within = divmod(position, len(self._steps))
        time, start = self._steps[epoch_order(len(self._steps), self._seed, epoch)[within]]
        views = self._times[time]
        order = epoch_order(len(views), self._seed, epoch, part=1 + time)
        return tuple(views[index] for index in order[start : start + self._views_per_step])
