"""Round: every rasterizer with every number of threads, once and in turn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import torch

from gsfw.core.splats import Splats
from gsfw.plugins.compose import choose_operators
from gsfw.plugins.loading import load_all
from gsfw.plugins.registry import Registry
from gsfw.rasterizers.gsplat.rasterizer import GsplatRasterizer
from gsfw.studies.bench.device import begin_peak, peak_mb
from gsfw.studies.bench.entrants import Candidate
from gsfw.studies.bench.gsplat_step import gsplat_steps
from gsfw.studies.bench.scene import SEED
from gsfw.studies.bench.step import TrainingStep
from gsfw.studies.bench.timing import Timings, timings_on
from gsfw.studies.bench.workload import Workload


@dataclass(frozen=True)
class Entrant:
    """One rasterizer with one number of threads."""

    rasterizer: str
    threads: int
    """0 for as many as there are: on a GPU it does not matter."""


class Bench:
    """Measures all entrants on one workload."""

    def __init__(
        self,
        workload: Workload,
        candidates: Mapping[str, Candidate],
        threads: Sequence[int],
        registry: Registry,
        sparse: bool = False,
    ) -> None:
        self.workload = workload
        self.device = workload.splats.means.device
        self.operators = choose_operators(registry, self.device)
        kinds = load_all("operators", registry)
        self.operators_name = next(
            name for name, kind in kinds.items() if type(self.operators) is kind
        )
        self.details = {
            name: item.rasterizer.capabilities().details for name, item in candidates.items()
        }
        self.timings: dict[Entrant, Timings] = {}
        self.peaks: dict[Entrant, dict[str, float]] = {}
        """Megabytes that a picture and a step took on a GPU at most, beyond what lay there."""
        self._candidates = candidates
        self._entrants = [Entrant(name, count) for count in threads for name in candidates]
        self._splats = _leaves(workload.splats)
        self._step = TrainingStep(workload, self.operators)
        self._sparse_step = TrainingStep(workload, self.operators, True) if sparse else None
        self._own_steps = {
            name: gsplat_steps(workload, self.operators, sparse)
            for name, item in candidates.items()
            if isinstance(item.rasterizer, GsplatRasterizer)
        }
        cameras = workload.cameras
        shape = (len(cameras), cameras.height, cameras.width, workload.splats.channels)
        gradient = torch.randn(shape, generator=torch.Generator().manual_seed(SEED))
        self._gradient = gradient.to(self.device)
        self.forget()

    def forget(self) -> None:
        """Begin the figures anew."""
        self.timings = {entrant: timings_on(self.device) for entrant in self._entrants}
        self.peaks = {entrant: {} for entrant in self._entrants}

    def round(self) -> None:
        """Let every entrant draw, forward and backward, and then do training steps."""
        for entrant, timings in self.timings.items():
            if entrant.threads:
                torch.set_num_threads(entrant.threads)
            candidate = self._candidates[entrant.rasterizer]
            if len(self.timings) > 1:
                # After another's turn threads sleep and caches are cold, as they never are in
                # training: one picture that does not count.
                self._draw(candidate, timings_on(self.device))
            with self._peak(entrant, "picture"):
                self._draw(candidate, timings)
            if candidate.staged is not candidate.rasterizer:
                self._draw_in_stages(candidate, timings)
            with self._peak(entrant, "step"):
                self._step.measure(candidate.rasterizer, candidate.settings, timings)
            for name, step in self._whole_steps(entrant.rasterizer).items():
                with self._peak(entrant, name), timings.stage(name):
                    step()

    def _whole_steps(self, name: str) -> dict[str, Callable[[], None]]:
        """Steps that are measured without their parts, by name."""
        steps: dict[str, Callable[[], None]] = {}
        if self._sparse_step:
            candidate = self._candidates[name]
            run = self._sparse_step.run
            steps["sparse_step"] = partial(run, candidate.rasterizer, candidate.settings)
        own = self._own_steps.get(name, {})
        return steps | {name: step.run for name, step in own.items()}

    @contextmanager
    def _peak(self, entrant: Entrant, name: str) -> Iterator[None]:
        """Note what was allocated inside beyond what was before."""
        before = begin_peak(self.device)
        yield
        if self.device.type == "cuda":
            peaks = self.peaks[entrant]
            peaks[name] = max(peaks.get(name, 0.0), peak_mb(self.device) - before)

    def _draw(self, candidate: Candidate, timings: Timings) -> None:
        rasterizer = candidate.rasterizer
        self._forget_gradients()
        with timings.stage("picture"):
            with timings.stage("forward"):
                output = rasterizer.render(self._splats, self.workload.cameras, candidate.settings)
            with timings.stage("backward"):
                output.color.backward(self._gradient)
        for name, reading in rasterizer.stage_times().items():
            timings.add(name, reading)
        self._forget_gradients()

    def _draw_in_stages(self, candidate: Candidate, timings: Timings) -> None:
        """Draw once more with the one that measures its stages, and is slower for that."""
        output = candidate.staged.render(self._splats, self.workload.cameras, candidate.settings)
        output.color.backward(self._gradient)
        for name, reading in candidate.staged.stage_times().items():
            timings.add(name, reading)
        self._forget_gradients()

    def _forget_gradients(self) -> None:
        for tensor in self._splats.tensors().values():
            tensor.grad = None


def _leaves(splats: Splats) -> Splats:
    """The same splats, every field a leaf that gathers a gradient."""
    return splats.map(lambda tensor: tensor.clone().requires_grad_())
