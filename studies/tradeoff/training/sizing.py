"""Sizing: how long and how large the runs of a search are, so that it ends in time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from gsfw.core.errors import ConfigError
from gsfw.studies.tradeoff.training.halving import cost, number_of_runs

DOWNSCALES = (1.0, 2.0, 4.0, 8.0)
"""Of the pictures, the finest first."""

PROBE_STEPS = 100
"""Of a run that only measures the speed."""

PASSES, ENOUGH_STEPS = 30, 3000
"""Steps are enough where they see each training view so often, and are at least so many; with
fewer, pictures are made smaller."""

PIXELS_TO_START = 2
"""Of a picture, for each Gaussian that a run starts with at random. With many more, short runs end
while density control is still taking them away, and say nothing of longer ones."""

LEAST_SIDE = 64
"""Pixels that pictures keep along their shorter side."""

USED = 0.8
"""Of the time, that the plan fills: longer runs have more Gaussians, and so slower steps, than
the short one that the speed was measured in."""


@dataclass(frozen=True)
class Speed:
    """What a short run took."""

    downscale: float
    step_seconds: float
    """Of a step, while as many runs as there will be were at work."""
    start_seconds: float
    """Of all else: the start, reading pictures, the evaluation."""


@dataclass(frozen=True)
class Work:
    """What is to be trained."""

    choices: int
    """Single choices that are tried."""
    lengths: tuple[float, ...]
    """Of the rounds, as parts of the longest, the shortest first."""
    jobs: int
    """Runs at a time."""

    def steps(self, speed: Speed, minutes: float) -> int:
        """Of the longest runs, so that all of it fits into some minutes; 0 where nothing does."""
        starts = number_of_runs(self.choices, len(self.lengths)) * speed.start_seconds
        seconds = minutes * 60 * USED * self.jobs - starts
        steps = seconds / cost(self.choices, self.lengths) / speed.step_seconds
        return round_down(steps)

    def seconds(self, speed: Speed, steps: int) -> float:
        """Until all of it is made, about."""
        training = cost(self.choices, self.lengths) * steps * speed.step_seconds
        starts = number_of_runs(self.choices, len(self.lengths)) * speed.start_seconds
        return (training + starts) / self.jobs


def round_down(steps: float) -> int:
    """To two digits, so that commands are easily read."""
    whole = max(0, int(steps))
    unit = max(1, 10 ** (len(str(whole)) - 2))
    return whole // unit * unit


def enough_steps(views: int) -> int:
    """Below which smaller pictures gain more than further steps would."""
    return max(ENOUGH_STEPS, PASSES * views)


def enough_to_start(pixels: float) -> int:
    """Gaussians at random that pictures of so many pixels have a use for."""
    return max(1, round_down(pixels / PIXELS_TO_START))


def sizes(width: int, height: int) -> Iterator[float]:
    """Factors by which pictures may be made smaller, the finest first."""
    side = min(width, height)
    yield from (factor for factor in DOWNSCALES if factor == 1 or side / factor >= LEAST_SIDE)


@dataclass(frozen=True)
class Sizing:
    """What was chosen."""

    steps: int
    """Of the longest runs."""
    downscale: float
    """Of the baseline's pictures."""
    seconds: float | None
    """That all of it takes, about; ``None`` where nothing was measured."""
    step_seconds: float = 0.0
    """Of a step, where it was measured."""
    start_seconds: float = 0.0
    """Of all else of a run."""


Measure = Callable[[Sequence[float], int], Sequence[Speed]]
"""Trains runs of so many steps on pictures that are smaller by some factors, at the same time; the
speeds of those that ended in time, in the same order."""


def choose(
    work: Work,
    views: int,
    downscales: Sequence[float],
    steps: int | None,
    measure: Measure,
    left: Callable[[], float],
) -> Sizing:
    """Steps and size that fill the time.

    A run of ``PROBE_STEPS`` says what steps take at each size. One that is as long as the shortest
    of the runs to come then says it better: many Gaussians go soon after the start, or come late.

    Args:
        work: that is to be done.
        views: that are trained on.
        downscales: that may be chosen, the finest first; at least one.
        steps: of the longest runs, where they are not to be chosen.
        measure: makes the runs that measure the speed.
        left: minutes that are left.

    Raises:
        ConfigError: there is no time for runs that would say anything.
    """
    speeds = measure(downscales, PROBE_STEPS)
    if not speeds:
        raise ConfigError(
            f"budget.minutes: the {left():.1f} minutes that are left are not enough to measure how "
            "long steps take.",
            "Give more, or steps and downscale: then nothing is measured.",
        )
    speed = _pick(work, views, speeds, steps, left())
    longer = round_down(work.lengths[0] * (steps or work.steps(speed, left())))
    if longer > PROBE_STEPS or speed is not speeds[0]:
        place = speeds.index(speed)
        near = [item.downscale for item in speeds[max(0, place - 1) : place + 1]]
        longer = max(longer, 2 * PROBE_STEPS)
        speed = _pick(work, views, measure(near, longer) or [speed], steps, left())
    chosen = work.steps(speed, left()) if steps is None else steps
    if steps is None and chosen < PROBE_STEPS:
        least = work.seconds(speed, PROBE_STEPS) / USED / 60
        minutes = max(0.0, left())
        raise ConfigError(
            f"budget.minutes: in the {minutes:.1f} minutes that are left runs would have {chosen} "
            "steps, which says nothing.",
            f"Measuring aside, about {least:.1f} are needed here; or give fewer axes, or a larger "
            "downscale.",
        )
    seconds = work.seconds(speed, chosen)
    return Sizing(chosen, speed.downscale, seconds, speed.step_seconds, speed.start_seconds)


def _pick(
    work: Work, views: int, speeds: Sequence[Speed], steps: int | None, minutes: float
) -> Speed:
    """The finest size at which there is time for enough steps, or the smallest."""
    wanted = enough_steps(views) if steps is None else steps
    fine = (speed for speed in speeds if work.steps(speed, minutes) >= wanted)
    return next(fine, speeds[-1])
