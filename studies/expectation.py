"""Expectation: the time, memory and disk of a run on this machine, from a few of its own steps.

The composed run trains on a few of its views with its first number of Gaussians, and once more with
about the number that it will end with. Neither leaves a file. How far density control lets a model
grow depends on the scene: the number is a guess (see ``expected_gaussians``), and the line says it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import torch
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.callback import Callback, Control
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.loop.evaluation import render_model
from gsfw.core.loop.memory import added_memory_mb, peak_memory_mb
from gsfw.core.loop.resolution import FULL_SIZE
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.progress import stage
from gsfw.core.sampler import Sampler
from gsfw.core.scene import Scene
from gsfw.core.words import duration
from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.registry import Registry

GAUSSIANS_PER_PIXEL = 0.45
"""Gaussians of a finished model per pixel of one view: 0.45 on fox at 359x640 and 0.41 on garden at
648x420, with the default settings of method 3dgs."""
GROWTH = 1.05
"""Factor by which a model grows in one refinement, about; MCMC grows by just this."""
MOST_TRIED = 200_000
"""Gaussians of the second trial at most; costs of more are extrapolated in proportion."""
VIEWS, STEPS, SECONDS = 2, 3, 1.2
"""Views that a trial steps through, its steps at least, and the seconds that it takes at least."""
PLY_BYTES = 4
"""Bytes of a number in splats.ply, which holds three zeros as normals besides the model's."""
LOG_BYTES = 1000
"""Bytes of a logged step, in metrics.jsonl and TensorBoard; measured."""
IMAGE_BYTES = 2.0
"""Bytes of a pixel in TensorBoard; measured: 1.6 on the built-in scene, 2.1 on fox."""
IMAGES_OF_VIEW = 3
"""Images of a view in TensorBoard: the photo, the render and their difference."""
END_MB = 100.0
"""Memory that evaluation, TensorBoard and plots take besides training; measured on two scenes."""
IMAGES_SHOWN = 4
"""Views that TensorBoard shows of one evaluation."""
CHECKPOINTS_KEPT = 2
"""Checkpoints that a run folder keeps."""


@dataclass(frozen=True)
class Expectation:
    """The expected costs of a run."""

    gaussians: int
    """At the end."""
    seconds: float
    """From the start of the process to its end."""
    step_seconds: float
    """Seconds of a step at the start."""
    last_step_seconds: float
    """Seconds of a step at the end."""
    memory_mb: float
    """Peak memory of the process, in 1e6 bytes."""
    gpu_memory_mb: float | None
    """Peak allocations on the GPU; ``None`` on the CPU."""
    disk_mb: float
    """Size of the run folder."""

    def __str__(self) -> str:
        gpu = "" if self.gpu_memory_mb is None else f" and {self.gpu_memory_mb / 1e3:.1f} GB of GPU"
        return (
            f"expected on this machine: {duration(self.seconds)}, {self.memory_mb / 1e3:.1f} GB of "
            f"memory{gpu}, {self.disk_mb:.0f} MB of disk, if the model grows to "
            f"{self.gaussians:,} Gaussians ({1e3 * self.step_seconds:.0f} ms a step now, "
            f"{1e3 * self.last_step_seconds:.0f} ms then)"
        )

    def document(self) -> dict[str, Any]:
        """Plain data for programs."""
        return asdict(self)


def expect(composition: Composition, registry: Registry, so_far: float) -> Expectation:
    """Measure a run that has not started; it can not be used afterwards.

    Args:
        composition: of the run.
        registry: what is installed.
        so_far: seconds since the process was started.
    """
    parts, plan = composition.parts, composition.plan
    start = len(parts.table)
    end = expected_gaussians(composition)
    with stage("measuring how long steps take here", 2) as advance:
        loading = _seconds_to_load(composition)
        first = _try(composition)
        advance(1)
        before = peak_memory_mb(parts.device)
        last = first
        if end > start and len(composition.scene.points):
            last = _try_denser(composition, registry, min(end, MOST_TRIED))
    after = peak_memory_mb(parts.device)
    growth = 0.0 if last.rows == first.rows else (end - first.rows) / (last.rows - first.rows)

    def at_end(low: float, high: float) -> float:
        """A cost that grows with the rows, at the end."""
        return low + growth * (high - low) if growth else low * end / max(first.rows, 1)

    last_step = max(first.step, at_end(first.step, last.step))
    held_out, sampled = len(parts.data.views(Split.EVAL)), plan.eval_views
    view = max(first.view, at_end(first.view, last.view))
    images = len(parts.data.views(Split.TRAIN)) + len(parts.data.views(Split.EVAL))
    evaluations = 1 + ((plan.steps - 1) // plan.eval_every if plan.eval_every else 0)
    seconds = (
        so_far
        + images * loading / min(4, os.cpu_count() or 1)
        + _steps_seconds(composition, first.step, last_step)
        + (evaluations - 1) * (min(held_out, sampled) if sampled else held_out) * view
        # All at the end, and once more for the requirements that are measured then.
        + 2 * held_out * view
    )
    state = at_end(first.state_bytes, last.state_bytes)
    memory = max(before["rss"], at_end(before["rss"], after["rss"]) if growth else 0.0)
    return Expectation(
        gaussians=end,
        seconds=seconds,
        step_seconds=first.step,
        last_step_seconds=last_step,
        memory_mb=memory + _cache_mb(composition) + END_MB,
        gpu_memory_mb=None if last.gpu_mb is None else at_end(first.gpu_mb or 0.0, last.gpu_mb),
        disk_mb=_disk_mb(composition, state, end, evaluations),
    )


def expected_gaussians(composition: Composition) -> int:
    """About how many Gaussians a run ends with.

    A strategy that refines lets them grow by ``GROWTH`` a refinement, up to its own limit and to
    ``GAUSSIANS_PER_PIXEL``; others leave them as they are.
    """
    start, flat = len(composition.parts.table), composition.settings.flat()
    every = int(flat.get("strategy.refine_every", 0))
    if not every:
        return start
    stop = min(int(flat.get("strategy.refine_stop", 0)), composition.plan.steps)
    rounds = max(0, (stop - 1 - int(flat.get("strategy.refine_start", 0))) // every)
    grown = int(start * GROWTH ** min(rounds, 300))
    budget = str(flat.get("strategy.budget", ""))
    limits = [
        int(flat.get("strategy.max_gaussians") or 0),
        int(flat.get("strategy.cap_max") or 0),
        int(budget) if budget.isdigit() else 0,
    ]
    if not flat.get("strategy.cap_max"):
        cameras = composition.parts.data.views(Split.TRAIN).cameras
        pixels = median(camera.width * camera.height for camera in cameras)
        limits.append(max(start, int(GAUSSIANS_PER_PIXEL * pixels)))
    return min([grown, *(limit for limit in limits if limit)])


@dataclass(frozen=True)
class _Trial:
    """Costs of a few steps."""

    rows: int
    step: float
    """Seconds of a step."""
    view: float
    """Seconds to render one view and to compare it."""
    state_bytes: float
    """Bytes of a checkpoint."""
    gpu_mb: float | None


def _try_denser(composition: Composition, registry: Registry, count: int) -> _Trial:
    data = _Denser(composition.parts.data, count)
    return _try(compose(composition.settings, registry, data=data))


def _try(composition: Composition) -> _Trial:
    """Train a few steps at full size, on a few views that are loaded before."""
    parts, device = composition.parts, composition.parts.device
    views = [parts.sampler.next() for _ in range(VIEWS)]
    for group in views:
        parts.data.load(Split.TRAIN, group, device)
    clock, folder = _Clock(), _NoFolder(Path(os.devnull))
    parts = replace(parts, sampler=_Repeating(views))
    trainer = replace(composition, parts=parts).trainer(folder, [clock])
    trainer.plan = replace(trainer.plan, resolution=FULL_SIZE, checkpoint_every=0, eval_every=0)
    rows = len(parts.table)
    added = added_memory_mb(trainer.fit, device)
    step = median(clock.durations[1:] or clock.durations)
    seconds = _seconds_to_evaluate(composition)
    gpu = added if device.type == "cuda" else None
    return _Trial(rows, step, seconds, folder.state_bytes, gpu)


def _seconds_to_load(composition: Composition) -> float:
    """Seconds that decoding one view takes."""
    data = composition.parts.data
    started = time.perf_counter()
    data.load(Split.TRAIN, [len(data.views(Split.TRAIN)) - 1], composition.parts.device)
    return time.perf_counter() - started


def _seconds_to_evaluate(composition: Composition) -> float:
    parts, settings = composition.parts, composition.plan.settings
    (batch,) = parts.data.load(Split.TRAIN, [len(parts.data.views(Split.TRAIN)) - 1], parts.device)
    assert settings.background is not None
    started = time.perf_counter()
    image = render_model(parts.model, parts.rasterizer, batch.cameras, settings, batch.time).color[
        0
    ]
    for metric in parts.metrics.values():
        metric(image, batch.target(settings.background)[0], None)
    return time.perf_counter() - started


def _steps_seconds(composition: Composition, first: float, last: float) -> float:
    """Seconds of all steps, if the rows grow evenly until refinements end."""
    flat, steps = composition.settings.flat(), composition.plan.steps
    start = min(int(flat.get("strategy.refine_start", 0)), steps)
    stop = max(start, min(int(flat.get("strategy.refine_stop", steps)), steps))
    at_full_size = start * first + (stop - start) * (first + last) / 2 + (steps - stop) * last
    return at_full_size - _saved_steps(composition) * first


def _saved_steps(composition: Composition) -> float:
    """Steps' worth of time that smaller images save at the start: costs go with the pixels."""
    stages = composition.resolution.stages
    following = [first for first, _ in stages[1:]]
    pairs = zip(stages, following, strict=False)
    return sum(((end - first) * (1 - factor**-2) for (first, factor), end in pairs), start=0.0)


def _cache_mb(composition: Composition) -> float:
    """Megabytes of all decoded images, as far as the cache holds them."""
    data, channels = composition.parts.data, 4 if composition.scene.has_alpha else 3
    cameras = [camera for split in Split for camera in data.views(split).cameras]
    decoded = sum(camera.width * camera.height for camera in cameras) * channels / 1e6
    return min(decoded, float(composition.settings.config.cache_mb))


def _disk_mb(composition: Composition, state: float, gaussians: int, evaluations: int) -> float:
    model = sum(tensor.numel() for tensor in _tensors(dict(composition.parts.model.state_dict())))
    numbers = gaussians * (model / max(len(composition.parts.table), 1) + 3)
    cameras = composition.parts.data.views(Split.EVAL).cameras[:IMAGES_SHOWN]
    images = sum(camera.width * camera.height for camera in cameras) * IMAGES_OF_VIEW * IMAGE_BYTES
    logged = LOG_BYTES * composition.plan.steps / composition.plan.log_every
    total = CHECKPOINTS_KEPT * state + numbers * PLY_BYTES + images * evaluations + logged
    return total / 1e6


class _Clock(Callback):
    """Times steps, and ends a trial."""

    def __init__(self) -> None:
        self.durations: list[float] = []
        self._began = self._last = 0.0

    def on_start(self, run: object, control: Control) -> None:
        """Start the clock."""
        self._began = self._last = time.perf_counter()

    def on_tick(self, step: int, control: Control) -> None:
        """Note a step."""
        now = time.perf_counter()
        self.durations.append(now - self._last)
        self._last = now
        if step >= STEPS and now - self._began > SECONDS:
            control.request_stop("measured")


class _NoFolder(RunFolder):
    """Measures checkpoints and writes none."""

    state_bytes = 0.0

    def write_checkpoint(self, step: int, state: Mapping[str, Any], keep: int = 2) -> Path:
        """Note the size."""
        self.state_bytes = float(sum(tensor.nbytes for tensor in _tensors(state)))
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


class _Denser(DataManager):
    """A data set with more points to start from, beside those that it has."""

    def __init__(self, given: DataManager, count: int) -> None:
        self._given = given
        scene = given.scene
        points = scene.points
        chosen = torch.arange(count, device=points.device) % len(points)
        generator = torch.Generator().manual_seed(0)
        # Copies lie about as far from one another as points did, relative to their new number.
        apart = scene.extent / max(len(points), 1) ** 0.5
        shift = torch.randn(count, 3, generator=generator).to(points) * apart
        shift[: len(points)] = 0
        self._scene = replace(
            scene,
            points=points[chosen] + shift,
            point_colors=scene.point_colors[chosen],
            point_times=None if scene.point_times is None else scene.point_times[chosen],
        )

    @property
    def scene(self) -> Scene:
        """The scene with more points."""
        return self._scene

    def views(self, split: Split) -> Views:
        """The same views."""
        return self._given.views(split)

    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """The same images."""
        return self._given.load(split, indices, device)


def _tensors(state: object) -> list[Tensor]:
    """All tensors of a nested state."""
    if isinstance(state, Tensor):
        return [state]
    if isinstance(state, Mapping):
        state = list(state.values())
    if isinstance(state, list | tuple):
        return [tensor for item in state for tensor in _tensors(item)]
    return []
