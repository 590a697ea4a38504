"""Speed: how long steps take on this machine now, from short runs that are made for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gsfw.core.config import MethodConfig
from gsfw.core.errors import DataError
from gsfw.studies.estimate import START_SECONDS
from gsfw.studies.planned_run import PlannedRun, plan_runs
from gsfw.studies.result import Result
from gsfw.studies.runner import Runner, RunnerSettings
from gsfw.studies.study import Cell
from gsfw.studies.tradeoff.training.choice import BASELINE
from gsfw.studies.tradeoff.training.sizing import Speed
from gsfw.studies.tradeoff.training.trainer import Workshop

SEED = MethodConfig.seed
"""Of these runs, where none is given."""


class Stopped(Exception):
    """The user asked to stop while speeds were measured."""


def measure_speeds(
    given: Mapping[str, Any], shop: Workshop, downscales: Sequence[float], steps: int
) -> list[Speed]:
    """Train a run of so many steps at each size, as many at a time as there will be.

    Raises:
        DataError: a run failed, and why.
        Stopped: the user asked to stop.
    """
    cells = [
        Cell(
            BASELINE,
            f"speed of {steps} steps, downscale {factor:g}",
            {"seed": SEED, "eval_every": 0, **given, "downscale": factor, "steps": steps},
        )
        for factor in downscales
    ]
    plan = plan_runs(cells, shop.registry, Path(), shop.folder)
    runner = Runner(plan, shop.store, RunnerSettings(shop.jobs), shop.control, shop.lock)
    for ended in runner.run():
        if ended.failure is not None:
            raise DataError(ended.failure.error, ended.failure.advice)
    if shop.control.stop_reason is not None:
        raise Stopped
    return [_speed(run, shop.store.results[run.cell.key]) for run in plan]


def _speed(run: PlannedRun, result: Result) -> Speed:
    figures = result.figures
    training = float(figures["train_seconds"])
    wall = float(figures.get("wall_seconds", training + START_SECONDS))
    return Speed(float(run.settings["downscale"]), training / run.steps, max(0.0, wall - training))
