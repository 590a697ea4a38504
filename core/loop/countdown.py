"""Countdown: the remaining time of a run, from the events that a callback sees."""

from __future__ import annotations

import statistics
import time
from collections import deque

from gsfw.core.callback import RunInfo, StepReport
from gsfw.core.loop.remaining_time import RemainingTime

RECENT_REPORTS = 9
"""Reports whose median says how much longer than its steps the time between two of them is. A
pause, or a checkpoint, falls between two of them and does not count."""


PREDICT_SECONDS = 0.5
"""Least time between two predictions: one takes the host as long as a step of a small scene on a
GPU, whose run may report a hundred times a second."""


class Countdown:
    """Remaining time of a run; its owner forwards steps, reports and evaluations to it.

    Steps are not all that a run does: a page that shows it takes its share between them. So the
    time of the steps to come is stretched as that of the recent ones was.
    """

    def __init__(self, run: RunInfo) -> None:
        self._remaining = RemainingTime(run)
        self._ticked = self._estimated = self._reported = time.monotonic()
        self._seconds: float | None = None
        self._step, self._apart = run.first_step, 0.0
        self._stretches: deque[float] = deque(maxlen=RECENT_REPORTS)

    def tick(self) -> None:
        """Note the time after a step, since an evaluation may begin now."""
        self._ticked = time.monotonic()

    def report(self, report: StepReport) -> None:
        """Learn from a logged step; predict anew if the last prediction is old enough."""
        now, waiting = time.monotonic(), report.stage_ms.get("load", 0.0) / 1e3
        spent = (report.step - self._step) * report.step_ms / 1e3
        if spent > 0:
            self._stretches.append(max((now - self._reported - self._apart) / spent, 1.0))
        self._reported, self._step, self._apart = now, report.step, 0.0
        self._remaining.observe(
            report.step, report.num_gaussians, report.resolution, report.step_ms / 1e3, waiting
        )
        if self._seconds is None or now - self._estimated >= PREDICT_SECONDS:
            self._seconds = self._remaining.seconds(self.stretch)
            self._estimated = now

    @property
    def stretch(self) -> float:
        """Time from step to step, over that of the step itself; at least 1."""
        return statistics.median(self._stretches) if self._stretches else 1.0

    def evaluated(self, step: int, views: int) -> None:
        """Learn how long the evaluation took that ends now."""
        seconds = time.monotonic() - self._ticked
        self._apart += seconds
        self._remaining.evaluated(step, seconds, views)

    def skip(self, seconds: int | float) -> None:
        """Leave out a time in which the run waited for its user."""
        self._apart += seconds
        self._estimated += seconds

    def seconds(self) -> float | None:
        """Seconds until the end of the run, from now on; ``None`` as long as it cannot be known."""
        if self._seconds is None:
            return None
        return max(0.0, self._seconds - (time.monotonic() - self._estimated))
