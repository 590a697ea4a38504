"""Rounds: every rasterizer with every number of threads, once and in turn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial

import torch

from gsfw.core.loop.recording import Recording, on_default_stream, recorder_for
from gsfw.core.rasterizer import Rasterizer
from gsfw.plugins.loading import choose_operators, load_all
from gsfw.plugins.registry import Registry
from gsfw.rasterizers.gsplat.rasterizer import GsplatRasterizer
from gsfw.studies.bench.steps import TrainingStep, gsplat_steps
from gsfw.studies.bench.timing import Timings, begin_peak, peak_mb, timings_on
from gsfw.studies.bench.workload import SEED, Workload
from gsfw.studies.entrants import Entrant


@dataclass(frozen=True)
class Setup:
    """One rasterizer with one number of threads."""

    rasterizer: str
    threads: int
    """0 for all there are, as on a GPU."""


class Bench:
    """Measures entrants on one workload."""

    def __init__(
        self,
        workload: Workload,
        entrants: Sequence[Entrant],
        threads: Sequence[int],
        registry: Registry,
        sparse: bool = False,
    ) -> None:
        """Prepare the steps.

        Args:
            workload: to render.
            entrants: rasterizers on the device of the workload.
            threads: numbers of threads to measure each of them with.
            registry: everything installed.
            sparse: measure a step in which Adam updates visible rows only, too.
        """
        self.workload = workload
        self.device = workload.splats.means.device
        self.operators = choose_operators(registry, self.device)
        kinds = load_all("operators", registry)
        self.operators_name = next(
            name for name, kind in kinds.items() if type(self.operators) is kind
        )
        self.entrants = {entrant.name: entrant for entrant in entrants}
        self.timings: dict[Setup, Timings] = {}
        self.peaks: dict[Setup, dict[str, float]] = {}
        """Peak megabytes of an image and of a step on a GPU, beyond those allocated before."""
        self._staged = {entrant.name: entrant.with_stages() for entrant in entrants}
        self._setups = [Setup(name, count) for count in threads for name in self.entrants]
        self._splats = workload.splats.map(lambda tensor: tensor.clone().requires_grad_())
        self._step = TrainingStep(workload, self.operators)
        self._sparse_step = TrainingStep(workload, self.operators, True) if sparse else None
        self._own_steps = {
            entrant.name: gsplat_steps(workload, self.operators, sparse)
            for entrant in entrants
            if isinstance(entrant.rasterizer, GsplatRasterizer)
        }
        self._recorder = recorder_for(self.device)
        self._recordings: dict[str, Recording] = {}
        cameras = workload.cameras
        shape = (len(cameras), cameras.height, cameras.width, workload.splats.channels)
        gradient = torch.randn(shape, generator=torch.Generator().manual_seed(SEED))
        self._gradient = gradient.to(self.device)
        self.forget()

    def forget(self) -> None:
        """Drop all readings."""
        self.timings = {setup: timings_on(self.device) for setup in self._setups}
        self.peaks = {setup: {} for setup in self._setups}

    def round(self) -> None:
        """Measure every setup once: render, forward and backward, and do training steps."""
        with nullcontext() if self._recorder is None else self._recorder.working():
            self._round()

    def _round(self) -> None:
        for setup, timings in self.timings.items():
            if setup.threads:
                torch.set_num_threads(setup.threads)
            entrant = self.entrants[setup.rasterizer]
            staged = self._staged[setup.rasterizer]
            if len(self.timings) > 1:
                # After another's turn threads sleep and caches are cold, as they never are in
                # training: the first image does not count.
                self._render(entrant, timings_on(self.device))
            with self._peak(setup, "image"):
                self._render(entrant, timings)
            if staged is not entrant.rasterizer:
                self._render_in_stages(staged, entrant, timings)
            with self._peak(setup, "step"):
                self._step.measure(entrant.rasterizer, entrant.settings, timings)
            for name, step in self._whole_steps(entrant).items():
                with self._peak(setup, name), timings.stage(name):
                    step()
            for name, own in self._own_steps.get(entrant.name, {}).items():
                # gsplat's trainer knows no other stream, and neither does fused-ssim.
                with on_default_stream(self.device), self._peak(setup, name), timings.stage(name):
                    own.run()

    def _whole_steps(self, entrant: Entrant) -> dict[str, Callable[[], None]]:
        """Frames and steps of ours that are measured without their parts, by name."""
        steps: dict[str, Callable[[], None]] = {}
        rasterizer, settings = entrant.rasterizer, entrant.settings
        if self._sparse_step:
            steps["sparse_step"] = partial(self._sparse_step.run, rasterizer, settings)
        if self._recorder is None:
            return steps
        frame = partial(self._frame, entrant)
        steps["frame"] = frame
        if rasterizer.can_be_captured:
            step = partial(self._step.run, rasterizer, settings)
            steps["graph_frame"] = self._recorded(f"frame of {entrant.name}", frame).replay
            steps["graph_step"] = self._recorded(f"step of {entrant.name}", step).replay
        return steps

    @torch.no_grad()
    def _frame(self, entrant: Entrant) -> None:
        """Render as viewers do, without a graph of autograd."""
        entrant.rasterizer.render(self.workload.splats, self.workload.cameras, entrant.settings)

    def _recorded(self, name: str, work: Callable[[], None]) -> Recording:
        """The work as a CUDA graph; its kernels have been used before."""
        if name not in self._recordings:
            assert self._recorder is not None
            work()
            self._recordings[name] = self._recorder.record(work)
        return self._recordings[name]

    @contextmanager
    def _peak(self, setup: Setup, name: str) -> Iterator[None]:
        """Record the peak of memory of the block beyond the memory held before."""
        before = begin_peak(self.device)
        yield
        if self.device.type == "cuda":
            peaks = self.peaks[setup]
            peaks[name] = max(peaks.get(name, 0.0), peak_mb(self.device) - before)

    def _render(self, entrant: Entrant, timings: Timings) -> None:
        rasterizer = entrant.rasterizer
        self._forget_gradients()
        with timings.stage("image"):
            with timings.stage("forward"):
                output = rasterizer.render(self._splats, self.workload.cameras, entrant.settings)
            with timings.stage("backward"):
                output.color.backward(self._gradient)
        for name, reading in rasterizer.stage_times().items():
            timings.add(name, reading)
        self._forget_gradients()

    def _render_in_stages(self, staged: Rasterizer, entrant: Entrant, timings: Timings) -> None:
        """Render once more with the slower rasterizer that measures its stages."""
        output = staged.render(self._splats, self.workload.cameras, entrant.settings)
        output.color.backward(self._gradient)
        for name, reading in staged.stage_times().items():
            timings.add(name, reading)
        self._forget_gradients()

    def _forget_gradients(self) -> None:
        for tensor in self._splats.tensors().values():
            tensor.grad = None
