"""Runner: makes the missing runs of a study, several at a time, and estimates their time."""

from __future__ import annotations

import math
import shutil
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from statistics import mean

from gsfw.core.callback import Control
from gsfw.core.errors import ConfigError, DataError
from gsfw.jobs.executor import POLL_SECONDS, Executor, StartedJob, end_all
from gsfw.jobs.job import Resources
from gsfw.jobs.outcome import Outcome
from gsfw.studies.planned_run import PlannedRun
from gsfw.studies.result import Failure, Result, ResultStore, collect, today

START_SECONDS = 8.0
"""Start and end of a process around its training, about; where nothing is measured yet."""

STEP_SECONDS = 0.1
"""Seconds of a step before any is measured: about those of half-resolution images on two cores."""


def _is_planned(result: Result) -> bool:
    """True if a run had a time or a quality to end at."""
    return bool(result.settings.get("minutes") or result.settings.get("until"))


class Estimate:
    """Duration of runs, from results of the same cell; else of the scene, of the row, of any."""

    def __init__(self, results: Iterable[Result]) -> None:
        found = list(results)
        self._walls = [
            (result.row, result.scene, result.figures["wall_seconds"])
            for result in found
            if "wall_seconds" in result.figures
        ]
        # Steps of a planned run are those of its schedule, and no measure of other runs.
        timed = [
            r
            for r in found
            if r.figures.get("steps") and "train_seconds" in r.figures and not _is_planned(r)
        ]
        self._measured = [
            (result.row, result.scene, result.figures["train_seconds"] / result.figures["steps"])
            for result in timed
        ]
        self._starts = [
            max(0.0, result.figures["wall_seconds"] - result.figures["train_seconds"])
            for result in timed
            if "wall_seconds" in result.figures
        ]

    def seconds(self, run: PlannedRun) -> float:
        """Seconds that a run takes from its last checkpoint on; all of a run that is planned."""
        if run.limit is not None:
            cell = (run.cell.row, run.cell.scene)
            # One that ends at a quality needs less than its bound.
            return mean([s for *key, s in self._walls if tuple(key) == cell] or [run.limit])
        left = run.steps - (run.steps_done() or 0)
        start = mean(self._starts) if self._starts else START_SECONDS
        return start + left * self._step_seconds(run)

    def _step_seconds(self, run: PlannedRun) -> float:
        row, scene = run.cell.row, run.cell.scene
        same_cell = [s for r, c, s in self._measured if (r, c) == (row, scene)]
        same_scene = [s for _, c, s in self._measured if c == scene]
        same_row = [s for r, _, s in self._measured if r == row]
        for alike in (same_cell, same_scene, same_row, [s for _, _, s in self._measured]):
            if alike:
                return mean(alike)
        return STEP_SECONDS

    @property
    def is_measured(self) -> bool:
        """True if any run is known."""
        return bool(self._measured or self._walls)


@dataclass(frozen=True)
class RunnerSettings:
    """Settings of the runner."""

    resources: Resources = field(default_factory=Resources)
    """Resources of each run."""
    minutes: float | None = None
    """Time after which no further run starts; ``None`` for no limit."""
    again: bool = False
    """Make finished runs again."""
    keep_runs: bool = True
    """Keep the checkpoints of finished runs."""
    on_time: bool = False
    """Start only runs that should end within the minutes, and stop those that do not."""


@dataclass(frozen=True)
class Ended:
    """The end of a run."""

    run: PlannedRun
    result: Result | None
    failure: Failure | None
    """``None``, like ``result``, for a run that was stopped and goes on another time."""
    seconds: float
    """Since its process was started."""
    number: int
    """Runs that have ended in this session, this one included."""
    total: int
    """Runs of this session."""
    seconds_left: float
    """Estimated time until all runs are made."""


@dataclass(frozen=True)
class Working:
    """A run at work."""

    run: PlannedRun
    job: StartedJob


class Runner:
    """Makes runs; runs that are finished with the same settings are kept."""

    def __init__(
        self,
        plan: Sequence[PlannedRun],
        store: ResultStore,
        settings: RunnerSettings,
        control: Control,
        executor: Executor,
    ) -> None:
        """Find the runs that are missing.

        Args:
            plan: runs, in order.
            store: of their results.
            settings: of the runner.
            control: may request a stop.
            executor: does the runs.

        Raises:
            OutputError: a result that was found cannot be written.
        """
        self._store, self._settings, self._control = store, settings, control
        self._executor = executor
        self.pending: deque[PlannedRun] = deque()
        """Runs that are not made yet, in order."""
        self.kept = 0
        """Number of runs that had results."""
        self.working: list[Working] = []
        for run in plan:
            if settings.again or not self._is_kept(run):
                self.pending.append(run)
            else:
                self.kept += 1
        self._total = len(self.pending)

    def _is_kept(self, run: PlannedRun) -> bool:
        """True if a run has a result, in the store or in its folder; the store then has it."""
        known = self._store.results.get(run.cell.key)
        # A signal may have ended a run after its result, before all of its files.
        if known is not None and known.is_of(run) and not run.folder.unfinished.exists():
            given = run.cell.relevant
            if known.given != given:  # Other words for the same settings.
                self._store.keep(replace(known, given=given))
            return True
        if not run.is_finished():
            return False
        try:
            self._store.keep(collect(run))
        except DataError:  # A damaged result is none.
            shutil.rmtree(run.folder.path, ignore_errors=True)
            return False
        return True

    def run(self) -> Iterator[Ended]:
        """Make the runs; yields each when it has ended.

        A requested stop or an exception ends the processes with a checkpoint.

        Raises:
            OutputError: a result cannot be written.
            UnavailableError: no machine has the resources of a run.
        """
        minutes = self._settings.minutes
        until = math.inf if minutes is None else time.monotonic() + 60 * minutes
        try:
            while True:
                seconds = until - time.monotonic()
                stopping = self._control.stop_reason is not None
                if not stopping and seconds > 0:
                    yield from self._start(seconds)
                elif stopping or self._settings.on_time:
                    for item in self.working:
                        item.job.stop()
                if not self.working:
                    return
                yield from self._look()
                time.sleep(POLL_SECONDS)
        finally:
            end_all(item.job for item in self.working)

    def _start(self, seconds: float) -> Iterator[Ended]:
        """Start jobs as far as there are places; yields runs that cannot go on."""
        resources = self._settings.resources
        while self.pending and len(self.working) < self._executor.places(resources):
            run = self._next(seconds)
            if run is None:
                return
            self.pending.remove(run)
            key = run.cell.key
            failure = self._store.failures.get(key)
            if self._settings.again or (failure is not None and not failure.resumable):
                shutil.rmtree(run.folder.path, ignore_errors=True)
            if self._settings.again or failure is not None:
                self._store.forget(key)
            try:
                self.working.append(Working(run, self._executor.start(run.job(resources))))
            except ConfigError as error:  # In the file beside the checkpoint.
                advice = "The same command removes its folder and trains the run again."
                outcome = Outcome(False, 0.0, resumed=True, error=error.message, advice=advice)
                yield self._ended(run, outcome)

    def _next(self, seconds: float) -> PlannedRun | None:
        """The first run that fits into the seconds that are left; ``None`` for none."""
        if not self._settings.on_time or seconds == math.inf:
            return self.pending[0] if self.pending else None
        estimate = Estimate(self._store.results.values())
        return next((run for run in self.pending if estimate.seconds(run) <= seconds), None)

    def _look(self) -> Iterator[Ended]:
        """Yield the runs whose jobs have ended."""
        for item in list(self.working):
            outcome = item.job.poll()
            if outcome is not None:
                self.working.remove(item)
                yield self._ended(item.run, outcome)

    def _ended(self, run: PlannedRun, outcome: Outcome) -> Ended:
        result = failure = None
        if outcome.finished:
            try:
                result = collect(run, None if outcome.resumed else outcome.seconds)
            except DataError as error:  # For example because the disk was full.
                outcome = replace(outcome, finished=False, error=error.message, advice=error.advice)
        if result is not None:
            self._store.keep(result)
            if not self._settings.keep_runs:
                shutil.rmtree(run.folder.checkpoints, ignore_errors=True)
        elif outcome.stopped:
            self.pending.append(run)
        else:
            cell, said = run.cell, (outcome.error, outcome.advice, outcome.resumable)
            failure = Failure(cell.row, cell.scene, cell.seed, *said, today())
            self._store.keep(failure)
        number = self._total - len(self.pending) - len(self.working)
        seconds, left = outcome.seconds, self.seconds_left()
        return Ended(run, result, failure, seconds, number, self._total, left)

    def seconds_left(self) -> float:
        """Estimated time until all runs are made."""
        estimate = Estimate(self._store.results.values())
        seconds = sum(estimate.seconds(run) for run in self.pending)
        seconds += sum(
            max(0.0, estimate.seconds(item.run) - item.job.seconds) for item in self.working
        )
        left = len(self.pending) + len(self.working)
        places = self._executor.places(self._settings.resources) if left else 1
        return seconds / max(1, min(places, left))
