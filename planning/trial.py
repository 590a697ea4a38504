"""Trial: the costs of a run on this machine, from a few of its own steps.

The composed run trains on a few of its views, and leaves no file. It cannot be used afterwards.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import torch
from torch import Tensor

from gsfw.core.callback import Callback, Control
from gsfw.core.datamanager import Split
from gsfw.core.loop.device import wait_for
from gsfw.core.loop.evaluation import render_model
from gsfw.core.loop.memory import added_memory_mb
from gsfw.core.loop.resolution import FULL_SIZE
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.sampler import Sampler
from gsfw.plugins.compose import Composition

VIEWS, STEPS = 2, 3
"""Views that a trial steps through, and its steps at least."""
SETTLED = 0.5
"""Last part of the steps that are measured: the first ones warm up, and have Gaussians that are
still far too large or too many."""


@dataclass(frozen=True)
class Trial:
    """Costs of a few steps."""

    rows: int
    step: float
    """Seconds of a step."""
    view: float
    """Seconds to render one view and to compare it."""
    state_bytes: float
    """Bytes of a checkpoint."""
    gpu_mb: float | None
    """Peak of the allocations on the GPU, in 1e6 bytes; ``None`` on the CPU."""


def try_steps(composition: Composition, seconds: float, most: float = math.inf) -> Trial:
    """Train a few steps at full size, on a few views that are loaded before.

    Args:
        composition: of the run.
        seconds: the trial takes so long, and ``STEPS`` steps at least.
        most: after so many seconds the trial ends with its next step, but not with the first: on a
            GPU that one also compiles and loads kernels.
    """
    parts, device = composition.parts, composition.parts.device
    views = [parts.sampler.next() for _ in range(VIEWS)]
    for group in views:
        parts.data.load(Split.TRAIN, group, device)
    clock, folder = _Clock(seconds, most, device), _NoFolder(Path(os.devnull))
    parts = replace(parts, sampler=_Repeating(views))
    trainer = replace(composition, parts=parts).trainer(folder, [clock])
    trainer.plan = replace(trainer.plan, resolution=FULL_SIZE, checkpoint_every=0, eval_every=0)
    rows = len(parts.table)
    added = added_memory_mb(trainer.fit, device)
    step = clock.settled()
    view = _seconds_to_evaluate(composition)
    gpu = added if device.type == "cuda" else None
    return Trial(rows, step, view, folder.state_bytes, gpu)


def seconds_to_load(composition: Composition) -> float:
    """Seconds that decoding one view takes."""
    data = composition.parts.data
    started = time.perf_counter()
    data.load(Split.TRAIN, [len(data.views(Split.TRAIN)) - 1], composition.parts.device)
    wait_for(composition.parts.device)
    return time.perf_counter() - started


def _seconds_to_evaluate(composition: Composition) -> float:
    parts, settings = composition.parts, composition.plan.settings
    (batch,) = parts.data.load(Split.TRAIN, [len(parts.data.views(Split.TRAIN)) - 1], parts.device)
    assert settings.background is not None
    wait_for(parts.device)
    started = time.perf_counter()
    image = render_model(parts.model, parts.rasterizer, batch.cameras, settings, batch.time).color[
        0
    ]
    for metric in parts.metrics.values():
        metric(image, batch.target(settings.background)[0], None)
    wait_for(parts.device)
    return time.perf_counter() - started


class _Clock(Callback):
    """Times steps, and ends a trial."""

    def __init__(self, seconds: float, most: float, device: torch.device) -> None:
        self._seconds, self._most, self._device = seconds, most, device
        self.durations: list[float] = []
        self._began = self._last = 0.0

    def on_start(self, run: object, control: Control) -> None:
        """Start the clock."""
        self._began = self._last = time.perf_counter()

    def on_tick(self, step: int, control: Control) -> None:
        """Note a step, when a GPU has finished it too."""
        wait_for(self._device)
        now = time.perf_counter()
        self.durations.append(now - self._last)
        self._last = now
        passed = now - self._began
        is_late = len(self.durations) > 1 and passed > self._most
        if (step >= STEPS and passed > self._seconds) or is_late:
            control.request_stop("measured")

    def settled(self) -> float:
        """Seconds of a step, in the median of the last ones."""
        return median(self.durations[-math.ceil(SETTLED * len(self.durations)) :])


class _NoFolder(RunFolder):
    """Measures checkpoints and writes none."""

    state_bytes = 0.0

    def write_checkpoint(self, step: int, state: Mapping[str, Any], keep: int = 2) -> Path:
        """Note the size."""
        self.state_bytes = float(sum(tensor.nbytes for tensor in tensors_of(state)))
        return self.path


class _Repeating(Sampler):
    """The same few views again and again."""

    def __init__(self, views: list[tuple[int, ...]]) -> None:
        self._views, self._place = views, -1

    def next(self) -> tuple[int, ...]:
        """The next of them."""
        self._place += 1
        return self._views[self._place % len(self._views)]

    def peek(self, count: int) -> tuple[int, ...]:
        """Nothing: all are loaded."""
        return ()

    def state_dict(self) -> dict[str, Any]:
        """Nothing that is kept."""
        return {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Nothing."""


def tensors_of(state: object) -> list[Tensor]:
    """All tensors of a nested state."""
    if isinstance(state, Tensor):
        return [state]
    if isinstance(state, Mapping):
        state = list(state.values())
    if isinstance(state, list | tuple):
        return [tensor for item in state for tensor in tensors_of(item)]
    return []
