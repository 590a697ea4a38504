"""Sampler progressive: a growing window of times, up to all times (Lee et al. 2024, Ex4DGS).

Motion is learned within a short window first, and tracked from there. The paper starts with 10 of
300 frames and adds 10 more every 400 of 40,000 steps, so that all are included after 30 % of the
run; so do we, in fewer and larger stages.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from gsfw.core.config import SamplerConfig
from gsfw.core.datamanager import Views
from gsfw.core.errors import ConfigError
from gsfw.core.ranges import number
from gsfw.core.sampler import Sampler
from gsfw.core.step_settings import steps_field
from gsfw.samplers.order import item_at
from gsfw.samplers.stepwise import StepwiseSampler
from gsfw.samplers.view_times import views_by_time


@dataclass
class ProgressiveConfig(SamplerConfig):
    """Views of the first times, then of more and more times."""

    window: float = number(0.1, above=0, at_most=1)
    """Share of the times that training starts with, in (0, 1]; at least one time."""
    growth: float = number(0.1, above=0, at_most=1)
    """Share of the times that is added every grow_every steps, in (0, 1]."""
    grow_every: int = steps_field(1000, at_least=1, floor=1)
    """Steps between two growths of the window."""
    views_per_step: int = number(1, at_least=1)
    """Views per step; their gradients are averaged."""

    def build(self, views: Views, seed: int, steps: int) -> Sampler:
        """Build the sampler.

        Raises:
            ConfigError: the views have no times, or the run ends before all times are included.
        """
        times = list(views_by_time(views, "progressive").values())
        sizes = window_sizes(len(times), self.window, self.growth)
        full_at = (len(sizes) - 1) * self.grow_every
        if full_at >= steps:
            raise ConfigError(
                f"sampler 'progressive': all {len(times)} times are in after {full_at} steps, and "
                f"the run has steps={steps}.",
                "Give a smaller sampler.grow_every, or a larger sampler.window or sampler.growth.",
            )
        stages = [[view for group in times[:size] for view in group] for size in sizes]
        return ProgressiveSampler(stages, self.grow_every, self.views_per_step, seed)


def window_sizes(times: int, window: float, growth: float) -> list[int]:
    """Number of included times of each stage, up to all; each stage has more than the last."""
    stages = math.ceil((1.0 - window) / growth - 1e-9) + 1
    shares = (min(window + stage * growth, 1.0) for stage in range(stages))
    return sorted({max(math.floor(share * times + 1e-6), 1) for share in shares} | {times})


class ProgressiveSampler(StepwiseSampler):
    """Within a stage, every view of the window once per epoch in random order."""

    is_schedule = True

    def __init__(
        self,
        stages: Sequence[Sequence[int]],
        grow_every: int,
        views_per_step: int,
        seed: int,
    ) -> None:
        super().__init__()
        self._stages = stages
        self._grow_every = grow_every
        self._views_per_step = views_per_step
        self._seed = seed

    def step(self, position: int) -> tuple[int, ...]:
        """``views_per_step`` views of the window; a step may reach into the stage's next epoch."""
        stage = min(position // self._grow_every, len(self._stages) - 1)
        first = (position - stage * self._grow_every) * self._views_per_step
        positions = range(first, first + self._views_per_step)
        views = self._stages[stage]
        return tuple(item_at(position, views, self._seed, part=stage) for position in positions)
