"""Progress: one line on the screen with the figures of the current step."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bars

from gsfw.callbacks.live_line import GAP, Figures, LiveLine
from gsfw.callbacks.notebook_line import NotebookLine
from gsfw.core.callback import Callback, Control, RunInfo, StepReport
from gsfw.core.loop.countdown import Countdown
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.notebook import is_notebook
from gsfw.core.progress import Advance, shown_by
from gsfw.core.words import metric_name, shown_metrics

SMOOTHING = 0.9
"""Weight of the past in the displayed loss and PSNR: single views differ too much."""
REFRESHES = 5.0
"""Updates of the line per second; each takes under a millisecond."""


class Progress(Callback):
    """A live line on a terminal or in a notebook; elsewhere regular plain lines.

    Terminals and files get them on standard error.
    """

    def __init__(self, seconds: float) -> None:
        """Write a plain line every ``seconds`` if there is no terminal."""
        self._seconds = seconds
        self._console = Console(stderr=True, highlight=False)
        self._live: Live | None = None
        self._notebook: NotebookLine | None = None
        self._stages: Bars | None = None
        self._run: RunInfo | None = None
        self._last_line = 0.0
        self._figures = Figures(0, 0)
        self._countdown: Countdown | None = None
        self._shown = ExitStack()

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Display the notes, then the line."""
        self._run, self._countdown = run, Countdown(run)
        self._figures = Figures(run.first_step, run.steps)
        for note in run.notes:
            self._say(f"note: {note}")
        if is_notebook():
            self._notebook = NotebookLine(self._figures)
            self._shown.enter_context(shown_by(self._notebook.stage))
        elif self._console.is_terminal and not self._console.is_dumb_terminal:
            self._go_live()

    def _go_live(self) -> None:
        """Display the line, and below it a bar for each stage of other work than steps."""
        console = self._console
        self._stages = Bars(
            TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), console=console
        )
        line = LiveLine(self._figures)
        self._live = Live(
            console=console,
            get_renderable=lambda: self._drawn(line),
            refresh_per_second=REFRESHES,
            transient=True,  # The summary of the run takes its place.
            redirect_stdout=sys.stdout.isatty(),  # A file gets what is printed meanwhile.
        )
        self._live.start()
        self._shown.enter_context(shown_by(self._stage))

    def _drawn(self, line: LiveLine) -> Group | LiveLine:
        assert self._countdown is not None
        self._figures.seconds_left = self._countdown.seconds()
        return line if self._stages is None or not self._stages.tasks else Group(line, self._stages)

    @contextmanager
    def _stage(self, name: str, total: int) -> Iterator[Advance]:
        """Display a second line below the first during other work than steps."""
        bars = self._stages
        assert bars is not None
        task = bars.add_task(name, total=total or None)
        try:
            yield lambda done: bars.update(task, completed=done)
        finally:
            bars.remove_task(task)

    def _say(self, line: str) -> None:
        self._console.print(line, markup=False, soft_wrap=not self._console.is_terminal)

    def on_tick(self, step: int, control: Control) -> None:
        """Advance the bar; without a terminal say that slow steps go on."""
        assert self._run is not None
        assert self._countdown is not None
        self._countdown.tick()
        self._figures.step = step
        if self._notebook is not None:
            self._figures.seconds_left = self._countdown.seconds()
            self._notebook.refresh()
        now = time.monotonic()
        logged = step == 1 or step % int(self._run.settings.get("log_every", 1)) == 0
        if self._is_plain and not logged and now - self._last_line >= self._seconds:
            self._tell(now)

    def on_step(self, report: StepReport, control: Control) -> None:
        """Update loss, PSNR, count, speed, remaining time and memory."""
        assert self._run is not None
        assert self._countdown is not None
        self._countdown.report(report)
        figures = self._figures
        figures.step = report.step
        figures.loss = _smoothed(figures.loss, report.loss)
        figures.psnr = _smoothed(figures.psnr, report.psnr)
        figures.gaussians, figures.skipped = report.num_gaussians, report.skipped_steps
        figures.steps_per_second = 1e3 / max(report.step_ms, 1e-3)
        figures.resolution, figures.memory_mb = report.resolution, report.memory_mb
        now = time.monotonic()
        is_due = now - self._last_line >= self._seconds or report.step == self._run.steps
        if self._is_plain and is_due:
            self._tell(now)

    @property
    def _is_plain(self) -> bool:
        """True if lines are printed one below the other."""
        return self._live is None and self._notebook is None

    def _tell(self, now: float) -> None:
        """Print a plain line."""
        assert self._countdown is not None
        self._last_line = now
        self._figures.seconds_left = self._countdown.seconds()
        self._say(GAP.join(text for _, text in self._figures.parts(is_short=False)).lstrip())

    def on_evaluation(self, step: int, evaluation: Evaluation, control: Control) -> None:
        """Print the means on a permanent line; those of the end are in the summary of the run."""
        assert self._run is not None
        assert self._countdown is not None
        self._countdown.evaluated(step, len(evaluation.views))
        self._figures.held_out_psnr = evaluation.means.get("psnr")
        if step == self._run.steps:
            return
        names = shown_metrics(evaluation.means, self._run.protocol)
        means = ", ".join(_figure(name, evaluation.means[name]) for name in names)
        figures = self._figures
        small = f" (training images have {figures.size} of their size)" * figures.is_small
        self._say(
            f"step {step}: {means} on {evaluation.count} held-out views{small}"
            if means
            else f"step {step}: no held-out views to evaluate"
        )

    def on_end(self, step: int, summary: Mapping[str, Any]) -> None:
        """Remove the line."""
        self.close()

    def close(self) -> None:
        """Release the terminal."""
        self._shown.close()
        if self._live is not None:
            self._live.stop()
            self._live = None
        if self._notebook is not None:
            self._notebook.close()
            self._notebook = None
        sys.stderr.flush()


def _figure(name: str, value: float) -> str:
    """A metric in words: "PSNR 30.52 dB", "SSIM 0.9871"."""
    is_psnr = name.endswith("psnr")
    return f"{metric_name(name)} {value:.2f} dB" if is_psnr else f"{metric_name(name)} {value:.4g}"


def _smoothed(past: float, now: float) -> float:
    return now if math.isnan(past) else SMOOTHING * past + (1 - SMOOTHING) * now
