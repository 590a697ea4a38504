"""LiveRun: what pages see of a run that trains, and what they may ask of it."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from gsfw.core.callback import RunInfo, StepReport
from gsfw.core.loop.countdown import Countdown

MOST_POINTS = 400
"""Points of a curve: twice as many are halved, so that long runs send no more than short ones."""
SMOOTHING = 0.9
"""Weight of the past in the curves: single views differ too much."""


@dataclass(frozen=True)
class RunStatus:
    """Figures of the last logged step."""

    step: int
    loss: float = math.nan
    """Smoothed."""
    psnr: float = math.nan
    """Smoothed, of training views, in dB."""
    gaussians: int = 0
    steps_per_second: float = 0.0
    memory_mb: float = 0.0
    held_out_psnr: float | None = None
    """PSNR of the last evaluation, in dB; ``None`` before one."""


@dataclass
class Curve:
    """Values over steps, thinned as they grow."""

    steps: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    _every: int = 1
    _seen: int = 0

    def add(self, step: int, value: float) -> None:
        """Append a value."""
        self._seen += 1
        if self._seen % self._every:
            return
        self.steps.append(step)
        self.values.append(value)
        if len(self.steps) >= 2 * MOST_POINTS:
            self.steps, self.values = self.steps[1::2], self.values[1::2]
            self._every *= 2

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Steps and values."""
        count = min(len(self.steps), len(self.values))
        return np.asarray(self.steps[:count], float), np.asarray(self.values[:count], float)


class LiveRun:
    """A run that trains, as pages see it, and the orders that they may give it.

    The training thread writes the figures, and reads the wishes between steps; pages do the
    reverse, each field being replaced as a whole.
    """

    def __init__(self, info: RunInfo, wake: Callable[[], None]) -> None:
        """Know the run; ``wake`` tells the training thread of a wish."""
        self.info = info
        self.status = RunStatus(info.first_step)
        self.step = info.first_step
        """Number of finished steps."""
        self.loss, self.psnr, self.held_out = Curve(), Curve(), Curve()
        self.share = 0.0
        """Part of the last seconds that frames took, measured."""
        self.finished = False
        self.checkpointed: int | None = None
        """Step of the last checkpoint; ``None`` before one."""
        self._wake = wake
        self._wishes = threading.Lock()
        self._paused = self._stop = self._checkpoint = self._waiting = False
        self._countdown = Countdown(info)

    # What pages ask for.

    @property
    def paused(self) -> bool:
        """True if the run is to wait after its step."""
        return self._paused

    def pause(self, paused: bool) -> None:
        """Let the run wait after its step, or go on."""
        self._paused = paused
        self._wake()

    @property
    def state(self) -> str:
        """The present state of the run, in a word or two."""
        if self.finished:
            return "finished"
        if self._waiting:
            return "paused" if self._paused else "waiting for an order"
        return "pausing" if self._paused else "training"

    @property
    def seconds_left(self) -> float | None:
        """Time until the end of the run; ``None`` while it cannot be known, or the run waits."""
        return None if self._waiting or self.finished else self._countdown.seconds()

    def stop(self) -> None:
        """End the run after its step, with a checkpoint."""
        with self._wishes:
            self._stop = True
        self._wake()

    def checkpoint(self) -> None:
        """Write a checkpoint after the step."""
        with self._wishes:
            self._checkpoint = True
        self._wake()

    def take_wishes(self) -> tuple[bool, bool]:
        """True to stop, and true to write a checkpoint; each wish is told once."""
        with self._wishes:
            taken = self._stop, self._checkpoint
            self._stop = self._checkpoint = False
        return taken

    @property
    def has_wishes(self) -> bool:
        """True if there is something to take."""
        return self._stop or self._checkpoint

    # What the training thread tells.

    def observe(self, report: StepReport) -> None:
        """Learn from a logged step."""
        before = self.status
        self._countdown.report(report)
        loss, psnr = _smoothed(before.loss, report.loss), _smoothed(before.psnr, report.psnr)
        self.loss.add(report.step, loss)
        self.psnr.add(report.step, psnr)
        self.status = RunStatus(
            step=report.step,
            loss=loss,
            psnr=psnr,
            gaussians=report.num_gaussians,
            steps_per_second=1e3 / max(report.step_ms, 1e-3),
            memory_mb=max(report.memory_mb.values(), default=0.0),
            held_out_psnr=before.held_out_psnr,
        )

    def ticked(self, step: int) -> None:
        """Note a step."""
        self.step = step
        self._countdown.tick()

    @contextmanager
    def waits(self) -> Iterator[None]:
        """The run makes no step inside: now it is paused, not before."""
        self._waiting = True
        try:
            yield
        finally:
            self._waiting = False

    def skip(self, seconds: int | float) -> None:
        """Leave a wait out of the time that steps take."""
        self._countdown.skip(seconds)

    def evaluated(self, step: int, psnr: float | None, views: int) -> None:
        """Learn from an evaluation."""
        self._countdown.evaluated(step, views)
        if psnr is not None:
            self.held_out.add(step, psnr)
            self.status = replace(self.status, held_out_psnr=psnr)


def _smoothed(past: float, now: float) -> float:
    if math.isnan(past) or not math.isfinite(now):
        return now if math.isnan(past) else past
    return SMOOTHING * past + (1 - SMOOTHING) * now
