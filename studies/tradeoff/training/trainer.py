"""Trainer: makes trials in processes of their own, keeps their results, and finds them again."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gsfw.core.callback import Control
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.registry import Registry
from gsfw.studies.planned_run import PlannedRun, plan_runs
from gsfw.studies.result import MEGABYTE, Result, ResultStore
from gsfw.studies.runner import Ended, Runner, RunnerSettings
from gsfw.studies.study import Cell
from gsfw.studies.tradeoff.training.axes import limited
from gsfw.studies.tradeoff.training.base import Base
from gsfw.studies.tradeoff.training.choice import Recipe
from gsfw.studies.tradeoff.training.search import Outcome, Trial

PSNR, SSIM = "judged_psnr", "judged_ssim"
"""Figures of a result: its accuracy in the size of the baseline's pictures."""

Judge = Callable[[PlannedRun, Result], Mapping[str, float]]
"""PSNR and SSIM of a finished run in the size of the baseline's pictures."""


@dataclass(frozen=True)
class Workshop:
    """Where and with what runs are made."""

    registry: Registry
    folder: Path
    store: ResultStore
    control: Control
    jobs: int
    """Runs at a time."""
    deadline: float | None = None
    """By ``time.monotonic``, when all runs have to have ended; ``None`` for no limit."""
    lock: int | None = None
    """An open file that every process holds as long as it lives."""


class Trainer:
    """Makes trials; each has a folder that its settings name, so that none is made twice."""

    def __init__(self, base: Base, workshop: Workshop, judge: Judge) -> None:
        self.base, self._shop, self._judge = base, workshop, judge
        self._first: dict[str, PlannedRun] = {}
        self._planned: dict[tuple[str, int], PlannedRun] = {}

    def plan(self, trial: Trial) -> PlannedRun | None:
        """The run of a trial: of those that mean the same, the first that was planned.

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
        """What one would type for a trial; ``None`` as for ``plan``."""
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
        """Make those that are missing, as far as there is time; each when it has ended."""
        shop = self._shop
        runs = {run.fingerprint: run for trial in trials if (run := self.plan(trial)) is not None}
        for run in runs.values():
            known = shop.store.results.get(run.cell.key)
            if known is not None and self._of(run) is None:
                shop.store.forget(known.key)
        minutes = None if shop.deadline is None else (shop.deadline - time.monotonic()) / 60
        settings = RunnerSettings(shop.jobs, minutes, on_time=True)
        runner = Runner(list(runs.values()), shop.store, settings, shop.control, shop.lock)
        for ended in runner.run():
            yield replace(ended, result=self._judged(ended.run))

    def missing(self, trials: Sequence[Trial]) -> list[PlannedRun]:
        """Runs of some trials that are not made."""
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
        """Of a trial that was made; it is judged where it was not yet."""
        run = self.plan(trial)
        return None if run is None else self._judged(run)

    def _of(self, run: PlannedRun) -> Result | None:
        """The result of a run whose folder is still there: it may have to be drawn."""
        result = self._shop.store.results.get(run.cell.key)
        if result is None or not result.is_of(run):
            return None
        return result if run_folder(result).summary.is_file() else None

    def outcome(self, trial: Trial) -> Outcome | None:
        """What counts of a trial when the next are chosen."""
        result = self.result(trial)
        if result is None:
            return None
        return Outcome(float(result.figures[PSNR]), MEGABYTE * megabytes(result))


def run_folder(result: Result) -> RunFolder:
    """Where the run of a result is: not where it would be made now, if settings are new in gsfw."""
    return RunFolder(Path(result.run))


def megabytes(result: Result) -> float:
    """Of the splats that a run writes; of its model's parameters where it writes none."""
    figures = result.figures
    return float(figures.get("splats_megabytes", figures["model_bytes"] / MEGABYTE))
