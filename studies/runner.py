"""Runner: makes the runs of a study that are not there yet, some at a time, and keeps each."""

from __future__ import annotations

import math
import shutil
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from gsfw.core.callback import Control
from gsfw.core.errors import ConfigError, DataError
from gsfw.studies.estimate import Estimate
from gsfw.studies.planned_run import PlannedRun
from gsfw.studies.result import Failure, Result, collect, today
from gsfw.studies.result_store import ResultStore
from gsfw.studies.run_process import Outcome, RunProcess
from gsfw.studies.threads import threads_per_run

POLL_SECONDS = 0.1
"""Between looks at the processes; nothing against what a run takes."""


@dataclass(frozen=True)
class RunnerSettings:
    """How runs are made."""

    jobs: int = 1
    """Runs at a time."""
    minutes: float | None = None
    """After which no further run is started; ``None`` for no limit."""
    again: bool = False
    """Whether finished runs are made again."""
    keep_runs: bool = True
    """Whether checkpoints of finished runs stay."""
    on_time: bool = False
    """Whether no run is started that should not end within the minutes, and those that have not
    ended then are stopped."""


@dataclass(frozen=True)
class Ended:
    """A run has ended, one way or another."""

    run: PlannedRun
    result: Result | None
    failure: Failure | None
    """Neither: it was asked to stop, and goes on another time."""
    seconds: float
    number: int
    """Runs that have ended in this session, this one included."""
    total: int
    """Runs there were to make."""
    seconds_left: float
    """Estimated time until all are made."""


class Runner:
    """Makes runs; what is finished with the same settings is kept as it is."""

    def __init__(
        self,
        plan: Sequence[PlannedRun],
        store: ResultStore,
        settings: RunnerSettings,
        control: Control,
        lock: int | None = None,
    ) -> None:
        """See what there is to do.

        Args:
            plan: runs, in order.
            store: where results are kept.
            settings: of the runner.
            control: that may ask it to stop.
            lock: an open file that every process holds as long as it lives.

        Raises:
            OutputError: a result that was found could not be written.
        """
        self._store, self._settings, self._control = store, settings, control
        self._lock = lock
        self.pending: deque[PlannedRun] = deque()
        """Runs that are not made yet; what is left of them at the end says why it is."""
        self.kept = 0
        """Runs whose results were there."""
        self.working: list[RunProcess] = []
        for run in plan:
            if settings.again or not self._is_kept(run):
                self.pending.append(run)
            else:
                self.kept += 1
        self._total = len(self.pending)

    def _is_kept(self, run: PlannedRun) -> bool:
        """Whether a run's result is there, in the file or at least in its folder."""
        known = self._store.results.get(run.cell.key)
        if known is not None and known.is_of(run):
            given = run.cell.relevant
            if known.given != given:  # Written otherwise, and meaning the same.
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
        """Make the runs, and tell of each when it has ended.

        A stop that ``control`` asks for, or an exception, ends the processes with a checkpoint.

        Raises:
            OutputError: a result could not be written.
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
                    for process in self.working:
                        process.stop()
                if not self.working:
                    return
                yield from self._look()
                time.sleep(POLL_SECONDS)
        finally:
            for process in self.working:
                process.stop(once_more=True)
            for process in self.working:
                process.wait()

    def _start(self, seconds: float) -> Iterator[Ended]:
        """Start as many processes as there may be; those runs that cannot go on."""
        while len(self.working) < self._settings.jobs:
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
            threads = threads_per_run(self._settings.jobs)
            try:
                self.working.append(RunProcess(run, threads, self._lock))
            except ConfigError as error:  # In the file beside the checkpoint.
                advice = "The same command removes its folder and makes the run anew."
                outcome = Outcome(False, 0.0, True, error=error.message, advice=advice)
                yield self._ended(run, outcome)

    def _next(self, seconds: float) -> PlannedRun | None:
        """The first run that may be started, where so many seconds are left; ``None`` for none."""
        if not self._settings.on_time or seconds == math.inf:
            return self.pending[0] if self.pending else None
        estimate = Estimate(self._store.results.values())
        return next((run for run in self.pending if estimate.seconds(run) <= seconds), None)

    def _look(self) -> Iterator[Ended]:
        """Those processes that have ended."""
        for process in list(self.working):
            outcome = process.poll()
            if outcome is not None:
                self.working.remove(process)
                yield self._ended(process.run, outcome)

    def _ended(self, run: PlannedRun, outcome: Outcome) -> Ended:
        result = failure = None
        if outcome.finished:
            try:
                result = collect(run, None if outcome.resumed else outcome.seconds)
            except DataError as error:  # As when the disk went full without a word.
                outcome = replace(outcome, finished=False, error=error.message, advice=error.advice)
        if result is not None:
            self._store.keep(result)
            if not self._settings.keep_runs:
                shutil.rmtree(run.folder.checkpoints, ignore_errors=True)
        elif outcome.stopped:
            self.pending.append(run)
        else:
            cell = run.cell
            failure = Failure(
                cell.row,
                cell.scene,
                cell.seed,
                outcome.error,
                outcome.advice,
                outcome.resumable,
                today(),
            )
            self._store.keep_failure(failure)
        left = len(self.pending) + len(self.working)
        return Ended(
            run,
            result,
            failure,
            outcome.seconds,
            self._total - left,
            self._total,
            self.seconds_left(),
        )

    def seconds_left(self) -> float:
        """Estimated time until all runs are made."""
        estimate = Estimate(self._store.results.values())
        seconds = sum(estimate.seconds(run) for run in self.pending)
        seconds += sum(
            max(0.0, estimate.seconds(process.run) - process.seconds) for process in self.working
        )
        return seconds / max(1, min(self._settings.jobs, len(self.pending) + len(self.working)))
