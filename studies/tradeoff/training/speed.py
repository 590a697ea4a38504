"""Speed: how long steps take on this machine now, from short runs that are made for it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gsfw.core.config import MethodConfig
from gsfw.core.errors import DataError
from gsfw.studies.planned_run import PlannedRun, plan_runs
from gsfw.studies.result import Result
from gsfw.studies.runner import START_SECONDS, Runner, RunnerSettings
from gsfw.studies.study import Cell
from gsfw.studies.tradeoff.training.choice import BASELINE
from gsfw.studies.tradeoff.training.sizing import Speed
from gsfw.studies.tradeoff.training.trainer import Workshop

SEED = MethodConfig.seed
"""Of these runs, where none is given."""


PART = 1 / 2
"""Of the time that is left: a size at which so few steps take longer is none to choose."""


class Stopped(Exception):
    """The user asked to stop while speeds were measured."""


def measure_speeds(sizes: Sequence[Mapping[str, Any]], shop: Workshop, steps: int) -> list[Speed]:
    """Train a run of so many steps at each size, as many at a time as there will be.

    The smallest pictures come first; sizes for which there is no time are left out.

    Args:
        sizes: settings of the runs, each with its downscale, the finest first.
        shop: where they are made.
        steps: of each.

    Raises:
        DataError: a run failed, and why.
        Stopped: the user asked to stop.
    """
    cells = [
        Cell(
            BASELINE,
            f"speed of {steps} steps, downscale {size['downscale']:g}, {shop.jobs} at a time",
            {"seed": SEED, "eval_every": 0, **size, "steps": steps},
        )
        for size in sizes
    ]
    plan = plan_runs(cells, shop.registry, Path(), shop.folder)
    minutes = None
    if shop.deadline is not None:
        minutes = PART * (shop.deadline - time.monotonic()) / 60
    settings = RunnerSettings(shop.jobs, minutes, on_time=True)
    runner = Runner(plan[::-1], shop.store, settings, shop.control, shop.lock)
    for ended in runner.run():
        if ended.failure is not None:
            raise DataError(ended.failure.error, ended.failure.advice)
    if shop.control.stop_reason is not None:
        raise Stopped
    found = ((run, shop.store.results.get(run.cell.key)) for run in plan)
    return [_speed(run, result) for run, result in found if result and result.is_of(run)]


def _speed(run: PlannedRun, result: Result) -> Speed:
    figures = result.figures
    training = float(figures["train_seconds"])
    wall = float(figures.get("wall_seconds", training + START_SECONDS))
    return Speed(float(run.settings["downscale"]), training / run.steps, max(0.0, wall - training))
