"""Stages: the forward pass of one camera, kernel after kernel, and its backward pass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.kernels.cuda import jobs
from gsfw.kernels.cuda.instances import Instances
from gsfw.kernels.cuda.launcher import Entry, Launcher, address
from gsfw.kernels.cuda.sort import radix_sort, sort_kernels
from gsfw.kernels.cuda.source_files import constant, enumerators
from gsfw.kernels.render_arguments import (
    POSE_FIELDS,
    KernelGradients,
    KernelInputs,
    KernelOutputs,
    KernelSettings,
    SplatGradients,
)
from gsfw.rasterizers.kernel_backend import ForwardPass, TooManyPairs

TILE = constant("stages.h", "TILE")
"""Side of a tile in pixels."""

TILE_PIXELS = TILE * TILE

SPLAT_CHANNELS = enumerators("stages.h", "SplatField")["SPLAT_CHANNELS"]
"""Fields of a splat before its channels."""

SUM_CHANNELS = enumerators("stages.h", "SumField")["SUM_CHANNELS"]
"""Sums per splat before those of its channels."""

PROJECT_THREADS = constant("splat.h", "PROJECT_THREADS")
BIN_THREADS = constant("stages.h", "BIN_THREADS")


class StageClock:
    """Pairs of CUDA events around stages; reading them waits for the device.

    Does nothing unless ``measuring``.
    """

    def __init__(self, measuring: bool, device: torch.device) -> None:
        self._measuring = measuring
        self._device = device
        self._events: dict[str, tuple[torch.cuda.Event, torch.cuda.Event]] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure what is launched within."""
        if not self._measuring:
            yield
            return
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


def instances_of(inputs: KernelInputs, settings: KernelSettings) -> Instances:
    """The kernel instances that render these inputs."""
    grid = _grid(settings)
    return Instances(
        dtype=inputs.splats.means.dtype,
        covariances=inputs.splats.covariances is not None,
        sh_degree=settings.sh_degree,
        channels=len(inputs.background),
        tile_key=torch.int16 if grid.columns * grid.rows <= 2**16 else torch.int32,
        ragged=inputs.splats.offsets is not None,
    )


def kernels_of(chosen: Instances, differentiated: bool) -> list[Entry]:
    """The kernels of an ordinary image, with or without its backward pass."""
    depth_key = torch.int32 if chosen.dtype == torch.float32 else torch.int64
    kernels: list[Entry] = [
        (chosen.project, jobs.ProjectJob),
        (chosen.emit, jobs.EmitJob),
        (chosen.find_tiles, jobs.TilesJob),
        (chosen.blend(measure=False), jobs.BlendJob),
        *sort_kernels(depth_key),
        *sort_kernels(chosen.tile_key),
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
        self._inputs, self._settings = inputs, settings
        self._channels = len(inputs.background)
        self._grid = _grid(settings)
        self._visible, self._radii = outputs.visible, outputs.radii
        clock = self._clock
        with clock.stage("project"):
            self._project()
        with clock.stage("sort"):
            order = self._sort_by_depth()
        with clock.stage("bin"):
            self._bin(order)
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

    def _project(self) -> None:
        means = self._inputs.splats.means
        n, width = len(means), SPLAT_CHANNELS + self._instances.width
        self._projected = means.new_empty(n, _multiple_of_4(width))
        key = torch.int32 if means.dtype == torch.float32 else torch.int64
        self._depth_keys = means.new_empty(n, dtype=key)
        self._tile_counts = means.new_empty(n, dtype=torch.int32)
        self._job = jobs.ProjectJob(
            view=self._view(),
            splats=self._splats(),
            grid=self._grid,
            level_min=self._settings.level_min,
            bounded=self._settings.alpha_min > 0,
            stride=self._projected.shape[1],
            projected=address(self._projected),
            depth_keys=address(self._depth_keys),
            tile_counts=address(self._tile_counts),
            visible=address(self._visible),
            radii=address(self._radii),
        )
        blocks = -(-n // PROJECT_THREADS)
        self._launcher.launch(self._instances.project, blocks, PROJECT_THREADS, self._job)

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

    def _sort_by_depth(self) -> Int[Tensor, " n"]:
        """All rows, the visible ones first, from front to back; equal depths by row."""
        bits = 8 * self._depth_keys.element_size()
        _, order = radix_sort(self._launcher, self._depth_keys, None, bits)
        del self._depth_keys
        return order

    def _bin(self, order: Int[Tensor, " n"]) -> None:
        counts = self._tile_counts[order]
        ends = counts.cumsum(0, dtype=torch.int64)
        pairs = int(ends[-1]) if len(ends) else 0  # The number that the host waits for.
        if pairs > self._settings.max_pairs:
            raise TooManyPairs(pairs)
        numbered = self._deterministic
        tiles = ends.new_empty(pairs, dtype=self._instances.tile_key)
        payload = ends.new_empty(pairs, dtype=torch.int32)
        rows = torch.empty_like(payload) if numbered else None
        job = jobs.EmitJob(
            grid=self._grid,
            bounded=self._job.bounded,
            stride=self._job.stride,
            projected=self._job.projected,
            order=address(order),
            count=len(order),
            tile_counts=address(self._tile_counts),
            ends=address(ends),
            tiles=address(tiles),
            payload=address(payload),
            rows=address(rows),
            numbered=numbered,
        )
        blocks = -(-len(order) // BIN_THREADS) if pairs else 0
        self._launcher.launch(self._instances.emit, blocks, BIN_THREADS, job)
        num_tiles = self._grid.columns * self._grid.rows
        bits = max(1, (num_tiles - 1).bit_length())
        tiles, payload = radix_sort(self._launcher, tiles, payload, bits)
        self._slots = payload if numbered else None
        self._pair_rows = payload if rows is None else rows[payload]
        self._find_tiles(tiles, num_tiles)
        if numbered:
            self._slot_lengths, self._order, self._ends = counts, order, ends

    def _find_tiles(self, tiles: Int[Tensor, " p"], num_tiles: int) -> None:
        """Find the first pair of each tile, and its chunks after the first."""
        starts = torch.empty(num_tiles + 1, dtype=torch.int64, device=tiles.device)
        job = jobs.TilesJob(address(tiles), len(tiles), num_tiles, 0, address(starts))
        blocks = -(-len(starts) // BIN_THREADS)
        self._launcher.launch(self._instances.find_tiles, blocks, BIN_THREADS, job)
        chunk = self._instances.chunk
        further = ((starts.diff() + (chunk - 1)) // chunk - 1).clamp_(min=0)
        self._tile_starts = starts
        self._chunk_starts = torch.zeros_like(starts)
        torch.cumsum(further, 0, out=self._chunk_starts[1:])

    def _blend(self, outputs: KernelOutputs) -> None:
        contribution = outputs.contribution
        measured = contribution
        if contribution is not None and self._slots is not None:
            measured = contribution.new_zeros(len(self._slots))
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
            rows=address(self._pair_rows),
            tile_starts=address(self._tile_starts),
            chunk_starts=address(self._chunk_starts),
            background=address(self._inputs.background),
            image=address(outputs.image),
            alpha=address(outputs.alpha),
            contribution=address(measured),
            pixel_weights=address(self._inputs.pixel_weights),
            slots=address(self._slots),
        )
        if settings.differentiated:
            self._keep_for_backward(outputs.alpha)
        kernel = self._instances.blend(contribution is not None)
        num_tiles = self._grid.columns * self._grid.rows
        self._launcher.launch(kernel, num_tiles, TILE * TILE, self._blend_job)
        if contribution is not None and measured is not None and measured is not contribution:
            self._add_contributions(measured, contribution)

    def _keep_for_backward(self, alpha: Float[Tensor, "h w"]) -> None:
        """Room for what the backward pass starts from."""
        chunks = len(self._pair_rows) // self._instances.chunk
        self._left = torch.empty_like(alpha)
        self._seen = torch.empty_like(alpha, dtype=torch.int32)
        self._checkpoints = alpha.new_empty(chunks, 1 + self._instances.width, TILE * TILE)
        self._chunk_tiles = torch.full(
            (chunks,), -1, dtype=torch.int32, device=self._pair_rows.device
        )
        job = self._blend_job
        job.left, job.seen = address(self._left), address(self._seen)
        job.checkpoints = address(self._checkpoints)
        job.chunk_tiles = address(self._chunk_tiles)

    def _add_contributions(self, measured: Tensor, contribution: Float[Tensor, " n"]) -> None:
        """Sum each splat's slots, in their order."""
        sums = torch.segment_reduce(
            measured, "sum", lengths=self._slot_lengths.long(), initial=0, unsafe=True
        )
        contribution[self._order] = sums

    def _blend_backward(self, gradients: KernelGradients) -> Tensor:
        absolute = gradients.absgrad is not None
        rows = len(self._pair_rows) if self._deterministic else len(self._tile_counts)
        stride = SUM_CHANNELS + self._channels + (2 if absolute else 0)
        sums = gradients.image.new_zeros(rows, stride)
        self._blend_job.image = address(gradients.rendered)
        job = jobs.BlendBackwardJob(
            forward=self._blend_job,
            image_gradient=address(gradients.image),
            alpha_gradient=address(gradients.alpha),
            chunks=len(self._chunk_tiles),
            sums=address(sums),
            sum_stride=stride,
        )
        blocks = self._grid.columns * self._grid.rows + len(self._chunk_tiles)
        kernel = self._instances.blend_backward(absolute)
        threads = self._instances.chunk_threads
        self._launcher.launch(kernel, blocks if len(self._pair_rows) else 0, threads, job)
        return sums

    def _project_backward(self, gradients: KernelGradients, sums: Tensor) -> None:
        n = len(self._tile_counts)
        blocks = -(-n // PROJECT_THREADS)
        pose = gradients.pose
        poses = None if pose is None else pose.new_zeros(blocks, POSE_FIELDS)
        slot_ends = None
        if self._deterministic:
            slot_ends = torch.empty_like(self._ends)
            slot_ends[self._order] = self._ends
        job = jobs.ProjectBackwardJob(
            forward=self._job,
            sums=address(sums),
            sum_stride=sums.shape[1],
            channels=self._channels,
            slot_ends=address(slot_ends),
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
