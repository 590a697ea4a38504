"""Countdown: the remaining time of a run, from the events that a callback sees."""

from __future__ import annotations

import time

from gsfw.core.callback import RunInfo, StepReport
from gsfw.core.loop.remaining_time import RemainingTime


class Countdown:
    """Remaining time of a run; its owner forwards steps, reports and evaluations to it."""

    def __init__(self, run: RunInfo) -> None:
        self._remaining = RemainingTime(run)
        self._ticked = self._estimated = time.monotonic()
        self._seconds: float | None = None

    def tick(self) -> None:
        """Note the time after a step, since an evaluation may begin now."""
        self._ticked = time.monotonic()

    def report(self, report: StepReport) -> None:
        """Learn from a logged step, and predict anew."""
        waiting = report.stage_ms.get("load", 0.0) / 1e3
        self._remaining.observe(
            report.step, report.num_gaussians, report.resolution, report.step_ms / 1e3, waiting
        )
        self._seconds, self._estimated = self._remaining.seconds(), time.monotonic()

    def evaluated(self, step: int, views: int) -> None:
        """Learn how long the evaluation took that ends now."""
        self._remaining.evaluated(step, time.monotonic() - self._ticked, views)

    def seconds(self) -> float | None:
        """Seconds until the end of the run, from now on; ``None`` as long as it cannot be known."""
        if self._seconds is None:
            return None
        return max(0.0, self._seconds - (time.monotonic() - self._estimated))
