"""Sampler sequential: one time after the other, as in an online method (Luiten et al. 2024).

The first time gets ``first_steps`` steps, for the reconstruction of the scene; the rest of the run
is shared evenly between the other times, for tracking. The paper gives 10,000 and 2,000 each.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

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
class SequentialConfig(SamplerConfig):
    """Times in order, each for some steps, and never again."""

    in_time_order: ClassVar[bool] = True
    first_steps: int = steps_field(10_000, at_least=1, floor=1)
    """Steps on the first time; the other times share the rest of the run evenly."""
    views_per_step: int = number(1, at_least=1)
    """Views of the current time per step, at most all views of the time."""

    def build(self, views: Views, seed: int, steps: int) -> Sampler:
        """Build the sampler.

        Raises:
            ConfigError: the views have no times, or some time would get no step.
        """
        times = list(views_by_time(views, "sequential").values())
        starts = time_starts(len(times), self.first_steps, steps)
        return SequentialSampler(times, starts, self.views_per_step, seed)


def time_starts(times: int, first_steps: int, steps: int) -> tuple[int, ...]:
    """First step of each time, counted from 0; later times get the remainder of the division.

    Raises:
        ConfigError: ``steps`` are too few to give every time at least one.
    """
    others, rest = times - 1, steps - first_steps
    if others == 0:
        return (0,)
    if rest < others:
        raise ConfigError(
            f"sampler 'sequential': steps={steps} less sampler.first_steps={first_steps} leaves "
            f"{max(rest, 0)} steps for {others} further times, and each needs one.",
            f"Give steps={first_steps + others} or more, or a smaller sampler.first_steps.",
        )
    share, longer = divmod(rest, others)
    extra = (max(time - (others - longer), 0) for time in range(others))
    return (0, *(first_steps + time * share + more for time, more in enumerate(extra)))


class SequentialSampler(StepwiseSampler):
    """Within a time, every view once per epoch in random order; the last time has no end."""

    is_schedule = True

    def __init__(
        self,
        times: Sequence[Sequence[int]],
        starts: Sequence[int],
        views_per_step: int,
        seed: int,
    ) -> None:
        super().__init__()
        self._times = times
        self._starts = starts
        self._views_per_step = views_per_step
        self._seed = seed

    def step(self, position: int) -> tuple[int, ...]:
        """Up to ``views_per_step`` views of the current time."""
        time = bisect_right(self._starts, position) - 1
        views = self._times[time]
        number = min(self._views_per_step, len(views))
        first = (position - self._starts[time]) * number
        positions = range(first, first + number)
        return tuple(item_at(position, views, self._seed, part=1 + time) for position in positions)
