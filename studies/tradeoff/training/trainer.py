"""Trainer: makes trials in processes of their own, finds earlier results, and measures speeds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gsfw.core.callback import Control
from gsfw.core.config import MethodConfig
from gsfw.core.errors import DataError
from gsfw.core.loop.run_folder import RunFolder
from gsfw.jobs.executor import Executor
from gsfw.jobs.job import Resources
from gsfw.plugins.registry import Registry
from gsfw.studies.planned_run import PlannedRun, plan_runs
from gsfw.studies.result import MEGABYTE, Result, ResultStore
from gsfw.studies.runner import START_SECONDS, Ended, Runner, RunnerSettings
from gsfw.studies.study import Cell
from gsfw.studies.tradeoff.training.axes import BASELINE, Recipe, limited
from gsfw.studies.tradeoff.training.base import Base
from gsfw.studies.tradeoff.training.search import Outcome, Trial
from gsfw.studies.tradeoff.training.sizing import Speed

PSNR, SSIM = "judged_psnr", "judged_ssim"
"""Figures of a result: its accuracy on images of the baseline's size."""

SEED = MethodConfig.seed
"""Seed of runs that measure the speed, where none is given."""

PART = 1 / 2
"""Part of the remaining time for runs that measure the speed; slower sizes are left out."""

Judge = Callable[[PlannedRun, Result], Mapping[str, float]]
"""Gives PSNR and SSIM of a finished run on images of the baseline's size."""


@dataclass(frozen=True)
class Workshop:
    """Folder, store and limits of the runs."""

    registry: Registry
    folder: Path
    store: ResultStore
    control: Control
    executor: Executor
    """Does the runs."""
    resources: Resources = field(default_factory=Resources)
    """Resources of each run."""
    deadline: float | None = None
    """Time by ``time.monotonic`` at which all runs have to have ended; ``None`` for no limit."""

    @property
    def jobs(self) -> int:
        """Runs at a time.

        Raises:
            UnavailableError: no machine has the resources of a run.
        """
        return self.executor.places(self.resources)


class Trainer:
    """Makes trials; each has a folder named by its settings, so that none is made twice."""

    def __init__(self, base: Base, workshop: Workshop, judge: Judge) -> None:
        self.base, self._shop, self._judge = base, workshop, judge
        self._first: dict[str, PlannedRun] = {}
        self._planned: dict[tuple[str, int], PlannedRun] = {}

    def plan(self, trial: Trial) -> PlannedRun | None:
        """The run of a trial; the same run for trials whose settings mean the same.

        ``None`` where it depends on a baseline that was not made.

        Raises:
            ConfigError: the recipe does not go with the base.
        """
        key = (trial.name, trial.seed)
        if key not in self._planned:
            settings = self.settings(trial)
            if settings is None:
                return None
            cell = Cell(trial.recipe.name, f"{trial.steps} steps", settings)
            (run,) = plan_runs([cell], self._shop.registry, Path(), self._shop.folder)
            self._planned[key] = self._first.setdefault(run.fingerprint, run)
        return self._planned[key]

    def settings(self, trial: Trial) -> dict[str, Any] | None:
        """Settings of a trial as they are typed; ``None`` as for ``plan``."""
        settings = {**self.base.given, **trial.recipe.settings}
        if trial.recipe.part is not None:
            baseline = self.result(Trial(Recipe(), trial.steps, self.base.seed))
            if baseline is None:
                return None
            most = max(1, round(trial.recipe.part * baseline.figures["num_gaussians"]))
            strategy = str(settings.get("strategy", self.base.values["strategy"]))
            settings |= limited(self.base.values, strategy, most)
        settings |= {"steps": trial.steps, "seed": trial.seed}
        return {"eval_every": 0, **settings}

    def train(self, trials: Iterable[Trial]) -> Iterator[Ended]:
        """Make missing trials as far as there is time; yields each when it has ended."""
        shop = self._shop
        runs = {run.fingerprint: run for trial in trials if (run := self.plan(trial)) is not None}
        for run in runs.values():
            known = shop.store.results.get(run.cell.key)
            if known is not None and self._of(run) is None:
                shop.store.forget(known.key)
        minutes = None if shop.deadline is None else (shop.deadline - time.monotonic()) / 60
        settings = RunnerSettings(shop.resources, minutes, on_time=True)
        runner = Runner(list(runs.values()), shop.store, settings, shop.control, shop.executor)
        for ended in runner.run():
            yield replace(ended, result=self._judged(ended.run))

    def missing(self, trials: Sequence[Trial]) -> list[PlannedRun]:
        """Runs of the trials that are not made yet."""
        runs = {run.fingerprint: run for trial in trials if (run := self.plan(trial)) is not None}
        return [run for run in runs.values() if self._of(run) is None]

    def _judged(self, run: PlannedRun) -> Result | None:
        """The result of a run with its accuracy; ``None`` where there is none."""
        result = self._of(run)
        if result is not None and PSNR not in result.figures:
            result = replace(result, figures={**result.figures, **self._judge(run, result)})
            self._shop.store.keep(result)
        return result

    def result(self, trial: Trial) -> Result | None:
        """The result of a trial, judged; ``None`` where it was not made."""
        run = self.plan(trial)
        return None if run is None else self._judged(run)

    def _of(self, run: PlannedRun) -> Result | None:
        """The result of a run whose folder still exists, since it may have to be rendered."""
        result = self._shop.store.results.get(run.cell.key)
        if result is None or not result.is_of(run):
            return None
        return result if run_folder(result).summary.is_file() else None

    def outcome(self, trial: Trial) -> Outcome | None:
        """The figures of a trial by which the next ones are chosen."""
        result = self.result(trial)
        if result is None:
            return None
        return Outcome(float(result.figures[PSNR]), MEGABYTE * megabytes(result))


def run_folder(result: Result) -> RunFolder:
    """Folder of a result's run, which new settings of gsfw do not rename."""
    return RunFolder(Path(result.run))


def megabytes(result: Result) -> float:
    """Megabytes of the splats that a run writes; of its parameters where it writes none."""
    figures = result.figures
    return float(figures.get("splats_megabytes", figures["model_bytes"] / MEGABYTE))


class Stopped(Exception):
    """The user has stopped the measurement of speeds."""


def measure_speeds(sizes: Sequence[Mapping[str, Any]], shop: Workshop, steps: int) -> list[Speed]:
    """Train a short run at each size, as many at a time as in the search.

    The smallest images come first; sizes for which there is no time are left out.

    Args:
        sizes: settings of the runs, each with its downscale, the finest first.
        shop: of the runs.
        steps: of each run.

    Raises:
        DataError: a run has failed; says why.
        Stopped: the user has asked for a stop.
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
    settings = RunnerSettings(shop.resources, minutes, on_time=True)
    runner = Runner(plan[::-1], shop.store, settings, shop.control, shop.executor)
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
