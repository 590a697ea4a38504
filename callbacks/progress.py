"""Progress: one line on the screen with the figures of the current step."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, TaskID, TextColumn
from rich.progress import Progress as Bar
from rich.table import Column as TableColumn

from gsfw.callbacks.remaining_time import RemainingTime
from gsfw.core.callback import Callback, Control, RunInfo, StepReport
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.progress import Advance, shown_by

SMOOTHING = 0.9
"""Weight of the past in the displayed loss and PSNR: single views differ too much."""


class Progress(Callback):
    """A live line on a terminal, or regular plain lines elsewhere; always on standard error."""

    def __init__(self, seconds: float) -> None:
        """Write a plain line every ``seconds`` if there is no terminal."""
        self._seconds = seconds
        self._console = Console(stderr=True, highlight=False)
        self._bar: Bar | None = None
        self._task = TaskID(0)
        self._run: RunInfo | None = None
        self._last_line = 0.0
        self._loss = self._psnr = float("nan")
        self._remaining: RemainingTime | None = None
        self._ticked = 0.0
        self._stages = ExitStack()

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Display the notes, then the line."""
        self._run, self._remaining = run, RemainingTime(run)
        for note in run.notes:
            self._say(f"note: {note}")
        if self._console.is_terminal:
            # The figures come first: on a narrow terminal the bar is truncated.
            self._bar = Bar(
                TextColumn("{task.description}", table_column=TableColumn(no_wrap=True)),
                BarColumn(bar_width=None),
                console=self._console,
                expand=True,
            )
            self._task = self._bar.add_task(
                f"{run.method} on {run.scene}", total=run.steps, completed=run.first_step
            )
            self._bar.start()
            self._stages.enter_context(shown_by(self._stage))

    @contextmanager
    def _stage(self, name: str, total: int) -> Iterator[Advance]:
        """Display a second line below the first during other work than steps."""
        assert self._bar is not None
        bar, task = self._bar, self._bar.add_task(name, total=total or None)
        try:
            yield lambda done: bar.update(task, completed=done)
        finally:
            bar.remove_task(task)

    def _say(self, line: str) -> None:
        self._console.print(line, markup=False, soft_wrap=True)

    def on_tick(self, step: int, control: Control) -> None:
        """Note the time, as an evaluation may begin now; say that slow steps go on."""
        self._ticked = time.monotonic()
        assert self._run is not None
        logged = step == 1 or step % int(self._run.settings.get("log_every", 1)) == 0
        if self._bar is None and not logged and self._ticked - self._last_line >= self._seconds:
            self._last_line = self._ticked
            self._say(f"{step}/{self._run.steps}")

    def on_step(self, report: StepReport, control: Control) -> None:
        """Update loss, PSNR, count, speed, remaining time and memory."""
        self._loss = _smoothed(self._loss, report.loss)
        self._psnr = _smoothed(self._psnr, report.psnr)
        assert self._run is not None
        assert self._remaining is not None
        self._remaining.observe(
            report.step,
            report.num_gaussians,
            report.resolution,
            report.step_ms / 1e3,
            report.stage_ms.get("load", 0.0) / 1e3,
        )
        line = self._line(report, self._run.steps)
        now = time.monotonic()
        if self._bar is not None:
            self._bar.update(self._task, completed=report.step, description=line)
        elif now - self._last_line >= self._seconds or report.step == self._run.steps:
            self._last_line = now
            self._say(line)

    def _line(self, report: StepReport, steps: int) -> str:
        assert self._remaining is not None
        seconds = self._remaining.seconds()
        left = "" if seconds is None else f"  about {_duration(seconds)} left"
        memory = "  ".join(f"{name} {mb / 1e3:.1f} GB" for name, mb in report.memory_mb.items())
        small = f"  at 1/{1 / report.resolution:.2g} size" if report.resolution < 1 else ""
        skipped = f"  {report.skipped_steps} skipped" if report.skipped_steps else ""
        return (
            f"{report.step}/{steps}  loss {self._loss:.4f}  psnr {self._psnr:.2f}{small}  "
            f"{report.num_gaussians:,} Gaussians  {1e3 / max(report.step_ms, 1e-3):.1f} it/s"
            f"{left}{skipped}  {memory}"
        )

    def on_evaluation(self, step: int, evaluation: Evaluation, control: Control) -> None:
        """Print the means on a permanent line."""
        assert self._remaining is not None
        seconds = time.monotonic() - self._ticked
        self._remaining.evaluated(step, seconds, len(evaluation.views))
        means = "  ".join(f"{name} {value:.4g}" for name, value in evaluation.means.items())
        self._say(
            f"step {step}: {evaluation.count} held-out views: {means}"
            if means
            else f"step {step}: no held-out views to evaluate"
        )

    def on_end(self, step: int, summary: Mapping[str, Any]) -> None:
        """Remove the line."""
        self.close()

    def close(self) -> None:
        """Release the terminal."""
        self._stages.close()
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
        sys.stderr.flush()


def _smoothed(past: float, now: float) -> float:
    return now if math.isnan(past) else SMOOTHING * past + (1 - SMOOTHING) * now


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
