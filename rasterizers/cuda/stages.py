"""Stages: the forward pass of one camera, kernel after kernel, and its backward pass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.kernels.cuda import jobs
from gsfw.kernels.cuda.arrays import Arrays
from gsfw.kernels.cuda.instances import Instances, instances
from gsfw.kernels.cuda.launcher import Entry, Launcher, address
from gsfw.kernels.cuda.source_files import constant, enumerators
from gsfw.kernels.render_arguments import (
    POSE_FIELDS,
    KernelGradients,
    KernelInputs,
    KernelOutputs,
    KernelSettings,
    SplatGradients,
)
from gsfw.rasterizers.cuda.bin import Binning, bin_kernels, row_arrays
from gsfw.rasterizers.cuda.pair_rooms import PairRooms
from gsfw.rasterizers.kernel_backend import ForwardPass

TILE = constant("stages.h", "TILE")
"""Side of a tile in pixels."""

TILE_PIXELS = TILE * TILE

SPLAT_CHANNELS = enumerators("splat_fields.h", "SplatField")["SPLAT_CHANNELS"]
"""Fields of a splat before its channels."""

SUM_CHANNELS = enumerators("stages.h", "SumField")["SUM_CHANNELS"]
"""Sums per splat before those of its channels."""

PROJECT_THREADS = constant("splat.h", "PROJECT_THREADS")

_NOT_MEASURED = nullcontext()


class StageClock:
    """Pairs of CUDA events around stages; reading them waits for the device.

    Does nothing unless ``measuring``.
    """

    def __init__(self, measuring: bool, device: torch.device) -> None:
        self._measuring = measuring
        self._device = device
        self._events: dict[str, tuple[torch.cuda.Event, torch.cuda.Event]] = {}

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Measure what is launched within."""
        return self._measured(name) if self._measuring else _NOT_MEASURED

    @contextmanager
    def _measured(self, name: str) -> Iterator[None]:
        begin, end = (torch.cuda.Event(enable_timing=True) for _ in range(2))
        # The stream of the GPU that renders, which may differ from torch's current device.
        stream = torch.cuda.current_stream(self._device)
        begin.record(stream)
        yield
        end.record(stream)
        self._events[name] = (begin, end)

    def times(self) -> Mapping[str, tuple[float, float]]:
        """Milliseconds of each stage so far; the same number for the device and for the wall."""
        if not self._events:
            return {}
        torch.cuda.synchronize(self._device)
        found = {name: begin.elapsed_time(end) for name, (begin, end) in self._events.items()}
        return {name: (time, time) for name, time in found.items()}


@dataclass(frozen=True)
class Launching:
    """The kernels of one image, and how they are run."""

    launcher: Launcher
    clock: StageClock
    instances: Instances
    deterministic: bool
    """True if gradients are summed in a fixed order."""
    rooms: PairRooms


def instances_of(inputs: KernelInputs, settings: KernelSettings) -> Instances:
    """The kernel instances that render these inputs."""
    grid = _grid(settings)
    return instances(
        dtype=inputs.splats.means.dtype,
        covariances=inputs.splats.covariances is not None,
        sh_degree=settings.sh_degree,
        channels=len(inputs.background),
        tile_key=torch.int16 if grid.columns * grid.rows <= 2**16 else torch.int32,
        ragged=inputs.splats.offsets is not None,
    )


def kernels_of(chosen: Instances, differentiated: bool) -> list[Entry]:
    """The kernels of an ordinary image, with or without its backward pass."""
    kernels: list[Entry] = [
        (chosen.project, jobs.ProjectJob),
        (chosen.blend(measure=False), jobs.BlendJob),
        *bin_kernels(chosen),
    ]
    if differentiated:
        kernels.append((chosen.blend_backward(absolute=False), jobs.BlendBackwardJob))
        kernels.append((chosen.project_backward(pose=False), jobs.ProjectBackwardJob))
    return kernels


class CudaForwardPass(ForwardPass):
    """The forward pass of one image. The host waits for the device only once.

    It reads the number of tile intersections, which tells how much memory they take.
    """

    def __init__(
        self,
        launching: Launching,
        inputs: KernelInputs,
        settings: KernelSettings,
        outputs: KernelOutputs,
    ) -> None:
        self._launcher, self._clock = launching.launcher, launching.clock
        self._instances, self._deterministic = launching.instances, launching.deterministic
        self._rooms, self._inputs, self._settings = launching.rooms, inputs, settings
        self._channels = len(inputs.background)
        self._grid = _grid(settings)
        self._visible, self._radii = outputs.visible, outputs.radii
        clock = self._clock
        with clock.stage("project"):
            binning = self._project()
        with clock.stage("sort"):
            words = binning.sort_by_depth()
        with clock.stage("bin"):
            self._pairs = binning.pairs(words, settings.differentiated)
        with clock.stage("blend"):
            self._blend(outputs)

    def backward(self, gradients: KernelGradients) -> None:
        """Write the gradients of the inputs, and the statistics that come with them."""
        with self._clock.stage("blend_backward"):
            sums = self._blend_backward(gradients)
        with self._clock.stage("project_backward"):
            self._project_backward(gradients, sums)

    def times(self) -> Mapping[str, tuple[float, float]]:
        """Milliseconds of each stage on the device, where they are measured."""
        return self._clock.times()

    def _project(self) -> Binning:
        """Project; what remains to be done for the pairs."""
        means = self._inputs.splats.means
        n, stride = len(means), _multiple_of_4(SPLAT_CHANNELS + self._instances.width)
        sizes = {"projected": (n * stride, means.dtype), "tile_counts": (n, torch.int32)}
        if self._deterministic:
            sizes["ends"] = (n, torch.int64)
        self._rows = Arrays(means.device, sizes)
        passing = row_arrays(n, means.dtype, means.device)
        self._job = jobs.ProjectJob(
            view=self._view(),
            splats=self._splats(),
            grid=self._grid,
            level_min=self._settings.level_min,
            bounded=self._settings.alpha_min > 0,
            stride=stride,
            projected=self._rows.address("projected"),
            depth_keys=passing.address("depth_keys"),
            tile_counts=self._rows.address("tile_counts"),
            visible=address(self._visible),
            radii=address(self._radii),
        )
        blocks = -(-n // PROJECT_THREADS)
        self._launcher.launch(self._instances.project, blocks, PROJECT_THREADS, self._job)
        return Binning(
            self._launcher,
            self._instances,
            self._job,
            passing,
            self._rows.address("ends"),
            self._settings.max_pairs,
            self._rooms,
        )

    def _view(self) -> jobs.View:
        settings = self._settings
        return jobs.View(
            world_to_camera=address(self._inputs.world_to_camera),
            intrinsics=address(self._inputs.intrinsics),
            jacobian_margin=settings.jacobian_margin,
            dilation=settings.dilation,
            compensation_min=settings.compensation_min,
            alpha_min=settings.alpha_min,
            near=settings.near,
            far=settings.far,
            length_max=settings.length_max,
            quaternion_min_norm=settings.quaternion_min_norm,
            model=settings.camera_model,
            antialias=settings.antialias,
        )

    def _splats(self) -> jobs.SplatArrays:
        splats = self._inputs.splats
        return jobs.SplatArrays(
            count=len(splats.means),
            means=address(splats.means),
            quats=address(splats.quats),
            scales=address(splats.scales),
            covariances=address(splats.covariances),
            opacities=address(splats.opacities),
            colors=address(splats.colors),
            rest=address(splats.rest),
            offsets=address(splats.offsets),
            rest_rows=0 if splats.rest is None else len(splats.rest),
            extra=address(splats.extra),
            color_stride=splats.colors.shape[1],
            rest_stride=_width(splats.rest),
            extras=_width(splats.extra),
            color_channels=3 if self._settings.sh_degree >= 0 else splats.colors.shape[1],
            depth_channels=self._settings.depth_channels,
        )

    def _blend(self, outputs: KernelOutputs) -> None:
        contribution, pairs = outputs.contribution, self._pairs.arrays
        measured = contribution
        if contribution is not None and self._deterministic:
            measured = contribution.new_zeros(self._pairs.count)
        settings = self._settings
        self._blend_job = jobs.BlendJob(
            grid=self._grid,
            level_min=settings.level_min,
            alpha_cap=settings.alpha_cap,
            alpha_limit=settings.alpha_limit,
            transmittance_min=settings.transmittance_min,
            projected=self._job.projected,
            stride=self._job.stride,
            channels=self._channels,
            bounded=self._job.bounded,
            rows=pairs.address("rows"),
            tile_starts=pairs.address("starts"),
            chunk_starts=pairs.address("chunk_starts"),
            background=address(self._inputs.background),
            image=address(outputs.image),
            alpha=address(outputs.alpha),
            contribution=address(measured),
            pixel_weights=address(self._inputs.pixel_weights),
            slots=pairs.address("slots"),
        )
        if settings.differentiated:
            self._keep_for_backward()
        kernel = self._instances.blend(contribution is not None)
        self._launcher.launch(kernel, self._num_tiles, TILE_PIXELS, self._blend_job)
        if contribution is not None and measured is not None and measured is not contribution:
            self._add_contributions(measured, contribution)

    @property
    def _num_tiles(self) -> int:
        return int(self._grid.columns * self._grid.rows)

    def _keep_for_backward(self) -> None:
        """Room for what the backward pass starts from."""
        dtype, pixels = self._instances.dtype, self._grid.width * self._grid.height
        chunks = self._pairs.room // self._instances.chunk
        self._checkpoints = Arrays(
            self._inputs.background.device,
            {
                "left": (pixels, dtype),
                "seen": (pixels, torch.int32),
                "checkpoints": (chunks * (1 + self._instances.width) * TILE_PIXELS, dtype),
            },
        )
        job = self._blend_job
        job.left, job.seen = (self._checkpoints.address(name) for name in ("left", "seen"))
        job.checkpoints = self._checkpoints.address("checkpoints")
        job.chunk_tiles = self._pairs.arrays.address("chunk_tiles")

    def _add_contributions(self, measured: Tensor, contribution: Float[Tensor, " n"]) -> None:
        """Sum each splat's slots, in their order."""
        order = self._pairs.order
        assert order is not None, "slots are numbered"
        lengths = self._rows.tensor("tile_counts")[order].long()
        sums = torch.segment_reduce(measured, "sum", lengths=lengths, initial=0, unsafe=True)
        contribution[order] = sums

    def _blend_backward(self, gradients: KernelGradients) -> Tensor:
        absolute, pairs = gradients.absgrad is not None, self._pairs
        rows = pairs.room if self._deterministic else int(self._job.splats.count)
        stride = SUM_CHANNELS + self._channels + (2 if absolute else 0)
        sums = gradients.image.new_zeros(rows, stride)
        self._blend_job.image = address(gradients.rendered)
        job = jobs.BlendBackwardJob(
            forward=self._blend_job,
            image_gradient=address(gradients.image),
            alpha_gradient=address(gradients.alpha),
            chunks=pairs.chunks,
            sums=address(sums),
            sum_stride=stride,
        )
        kernel = self._instances.blend_backward(absolute)
        blocks = self._num_tiles + pairs.chunks if pairs.count else 0
        self._launcher.launch(kernel, blocks, self._instances.chunk_threads, job)
        return sums

    def _project_backward(self, gradients: KernelGradients, sums: Tensor) -> None:
        blocks = -(-self._job.splats.count // PROJECT_THREADS)
        pose = gradients.pose
        poses = None if pose is None else pose.new_zeros(blocks, POSE_FIELDS)
        job = jobs.ProjectBackwardJob(
            forward=self._job,
            sums=address(sums),
            sum_stride=sums.shape[1],
            channels=self._channels,
            slot_ends=self._rows.address("ends"),
            gradients=_addresses(gradients.splats),
            screen_gradient=address(gradients.screen_gradient),
            absgrad=address(gradients.absgrad),
            pose=address(poses),
            accumulate=gradients.accumulate,
        )
        kernel = self._instances.project_backward(pose is not None)
        self._launcher.launch(kernel, blocks, PROJECT_THREADS, job)
        if pose is not None and poses is not None:
            pose += poses.sum(0)


def _addresses(gradients: SplatGradients) -> jobs.SplatGradients:
    return jobs.SplatGradients(
        means=address(gradients.means),
        quats=address(gradients.quats),
        scales=address(gradients.scales),
        covariances=address(gradients.covariances),
        opacities=address(gradients.opacities),
        colors=address(gradients.colors),
        rest=address(gradients.rest),
        extra=address(gradients.extra),
    )


def _grid(settings: KernelSettings) -> jobs.Grid:
    width, height = settings.width, settings.height
    return jobs.Grid(width, height, -(-width // TILE), -(-height // TILE))


def _multiple_of_4(count: int) -> int:
    return -(-count // 4) * 4


def _width(tensor: Tensor | None) -> int:
    return 0 if tensor is None else tensor.shape[1]
