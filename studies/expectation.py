"""Expectation: the time, memory and disk of a run on this machine, from a few of its own steps.

The composed run trains on a few of its views with its first number of Gaussians, and once more with
about the number that it will end with. Neither leaves a file. How far density control lets a model
grow depends on the scene: the number is a guess (see ``expected_gaussians``), and the line says it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import torch

from gsfw.core.batch import Batch
from gsfw.core.cores import cores
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.progress import stage
from gsfw.core.scene import Scene
from gsfw.core.words import duration, rough_size
from gsfw.planning.costs import disk_mb, expected_gaussians, memory_mb, most_that_fit
from gsfw.planning.trial import Trial, seconds_to_load, try_steps
from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.registry import Registry

TRIAL_SECONDS = 1.2
"""Seconds of steps in each of the two trials."""
MOST_TRIED = 200_000
"""Gaussians of the second trial at most; costs of more are extrapolated in proportion."""


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
    """Peak memory of the process by the estimate (``core.training_memory``), in 1e6 bytes."""
    gpu_memory_mb: float | None
    """Peak allocations on the GPU; ``None`` on the CPU."""
    disk_mb: float
    """Size of the run folder."""

    def __str__(self) -> str:
        gpu = "" if self.gpu_memory_mb is None else f" and {self.gpu_memory_mb / 1e3:.1f} GB of GPU"
        return (
            f"expected on this machine: {duration(self.seconds)}, {self.memory_mb / 1e3:.1f} GB of "
            f"memory{gpu}, {rough_size(1e6 * self.disk_mb)} of disk, if the model grows to "
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
        loading = seconds_to_load(composition)
        first = try_steps(composition, TRIAL_SECONDS)
        advance(1)
        last = first
        if end > start and len(composition.scene.points):
            last = _try_denser(composition, registry, min(end, MOST_TRIED))
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
        + images * loading / min(4, cores())
        + _steps_seconds(composition, first.step, last_step)
        + (evaluations - 1) * (min(held_out, sampled) if sampled else held_out) * view
        # All at the end, and once more for the requirements that are measured then.
        + 2 * held_out * view
    )
    state = at_end(first.state_bytes, last.state_bytes)
    return Expectation(
        gaussians=end,
        seconds=seconds,
        step_seconds=first.step,
        last_step_seconds=last_step,
        memory_mb=memory_mb(composition),
        gpu_memory_mb=None if last.gpu_mb is None else at_end(first.gpu_mb or 0.0, last.gpu_mb),
        disk_mb=disk_mb(composition, state, end, evaluations),
    )


def _try_denser(composition: Composition, registry: Registry, count: int) -> Trial:
    count = min(count, max(most_that_fit(composition), len(composition.parts.table)))
    data = _Denser(composition.parts.data, count)
    return try_steps(compose(composition.settings, registry, data=data), TRIAL_SECONDS)


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
