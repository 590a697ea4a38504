"""Sizing: length and image size of the runs of a search that ends in time, kept in a file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from gsfw.core.errors import ConfigError, DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text, read_document
from gsfw.studies.json_store import SCHEMA
from gsfw.studies.planned_run import fingerprint
from gsfw.studies.tradeoff.training.halving import cost, number_of_runs

ADVICE = "Move it away to choose anew."

DOWNSCALES = (1.0, 2.0, 4.0, 8.0)
"""Factors by which images may shrink, the finest first."""

PROBE_STEPS = 100
"""Length of a run that only measures the speed."""

PASSES, ENOUGH_STEPS = 30, 3000
"""Steps are enough if each training view is seen this often, and there are at least this many;
with fewer, images shrink."""

LEAST_SIDE = 64
"""Pixels of the shorter side of images at least."""

USED = 0.8
"""Part of the time that the plan fills: longer runs have more Gaussians, and so slower steps, than
the short run that measures the speed."""


@dataclass(frozen=True)
class Speed:
    """Times of a short run."""

    downscale: float
    step_seconds: float
    """Seconds of a step, with as many runs at a time as in the search."""
    start_seconds: float
    """Seconds of everything else: start, reading of images, evaluation."""


@dataclass(frozen=True)
class Work:
    """The training of a search."""

    choices: int
    """Number of single choices."""
    lengths: tuple[float, ...]
    """Lengths of the rounds as parts of the longest, the shortest first."""
    jobs: int
    """Runs at a time."""

    def steps(self, speed: Speed, minutes: float) -> int:
        """Steps of the longest runs of a search that fits into the minutes; 0 for none."""
        starts = number_of_runs(self.choices, len(self.lengths)) * speed.start_seconds
        seconds = minutes * 60 * USED * self.jobs - starts
        steps = seconds / cost(self.choices, self.lengths) / speed.step_seconds
        return round_down(steps)

    def seconds(self, speed: Speed, steps: int) -> float:
        """Duration of the search, about."""
        training = cost(self.choices, self.lengths) * steps * speed.step_seconds
        starts = number_of_runs(self.choices, len(self.lengths)) * speed.start_seconds
        return (training + starts) / self.jobs


def round_down(steps: float) -> int:
    """Round down to two digits, so that commands are easy to read."""
    whole = max(0, int(steps))
    unit = max(1, 10 ** (len(str(whole)) - 2))
    return whole // unit * unit


def enough_steps(views: int) -> int:
    """Number of steps below which smaller images help more than further steps."""
    return max(ENOUGH_STEPS, PASSES * views)


def sizes(width: int, height: int) -> Iterator[float]:
    """Factors by which images may shrink, the finest first."""
    side = min(width, height)
    yield from (factor for factor in DOWNSCALES if factor == 1 or side / factor >= LEAST_SIDE)


@dataclass(frozen=True)
class Sizing:
    """The chosen length and size."""

    steps: int
    """Steps of the longest runs."""
    downscale: float
    """Downscale of the baseline's images."""
    seconds: float | None
    """Duration of the search, about; ``None`` where nothing was measured."""
    step_seconds: float = 0.0
    """Measured seconds of a step."""
    start_seconds: float = 0.0
    """Measured seconds of everything else of a run."""


Measure = Callable[[Sequence[float], int], Sequence[Speed]]
"""Trains runs of a number of steps with some downscales at the same time; returns the speeds of
those that ended in time, in the same order."""


def choose(
    work: Work,
    views: int,
    downscales: Sequence[float],
    steps: int | None,
    measure: Measure,
    left: Callable[[], float],
) -> Sizing:
    """Choose steps and size that fill the time.

    A run of ``PROBE_STEPS`` measures steps at each size. A run as long as the shortest of the
    search then measures them better: many Gaussians vanish soon after the start, or come late.

    Args:
        work: of the search.
        views: number of training views.
        downscales: to choose from, the finest first; at least one.
        steps: of the longest runs; ``None`` to choose them.
        measure: makes the runs that measure the speed.
        left: gives the minutes that are left.

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


def read_plan(path: Path, request: Mapping[str, Any]) -> Sizing | None:
    """Read the choice for the same request; ``None`` for none.

    Raises:
        DataError: the file is damaged, or was written by a newer gsfw.
    """
    if not path.exists():
        return None
    document = read_document(path, SCHEMA, ADVICE)
    if document.get("request") != fingerprint(request):
        return None
    try:
        return Sizing(**document["sizing"])
    except (KeyError, TypeError):
        raise DataError(f"{path}: it is not as gsfw writes it.", ADVICE) from None


def write_plan(path: Path, request: Mapping[str, Any], sizing: Sizing) -> None:
    """Keep the choice for a request.

    Raises:
        OutputError: the file cannot be written.
    """
    document = {"schema": SCHEMA, "request": fingerprint(request), "sizing": asdict(sizing)}
    write_atomically(path, (json_text(document, indent=1) + "\n").encode())
