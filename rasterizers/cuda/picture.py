"""Picture: one camera's drawing, stage by stage, and its way back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.kernels.cuda import jobs
from gsfw.kernels.cuda.instances import Instances
from gsfw.kernels.cuda.launcher import Entry, Launcher, address
from gsfw.kernels.cuda.sort import radix_sort, sort_kernels
from gsfw.rasterizers.cuda.stage_clock import StageClock
from gsfw.rasterizers.painter import POSE_FIELDS, Arrays, Numbers, Picture, TooManyPairs

TILE = 16
"""Side of a tile in pixels, as stages.h has it."""

BRUSH_CHANNELS = 11
"""Fields of a brush before its channels, as stages.h has them."""

SUM_CHANNELS = 6
"""Sums per splat before those of its channels, as stages.h has them."""

PROJECT_THREADS = 64
"""As splat.h has it."""

BIN_THREADS = 256
"""As bin.cu has it."""

WARP = 32


@dataclass(frozen=True)
class Equipment:
    """What a picture is drawn with."""

    launcher: Launcher
    clock: StageClock
    instances: Instances
    deterministic: bool
    """Whether gradients are summed in a fixed order."""


def instances_of(arrays: Arrays, numbers: Numbers) -> Instances:
    """The kernels that draw these arrays."""
    grid = _grid(int(numbers["width"]), int(numbers["height"]))
    return Instances(
        dtype=_given(arrays, "means").dtype,
        covariances=arrays["covariances"] is not None,
        sh_degree=int(numbers["sh_degree"]),
        channels=_given(arrays, "background").shape[0],
        tile_key=torch.int16 if grid.columns * grid.rows <= 2**16 else torch.int32,
        ragged=arrays["offsets"] is not None,
    )


def kernels_of(chosen: Instances, differentiated: bool) -> list[Entry]:
    """What an ordinary picture launches, with or without its way back."""
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


class CudaPicture(Picture):
    """What the kernels of one picture share. Nothing waits for the device but one number.

    That number is the count of pairs, by which memory is asked for.
    """

    def __init__(
        self, equipment: Equipment, arrays: Arrays, numbers: Numbers, outputs: Arrays
    ) -> None:
        self._launcher, self._clock = equipment.launcher, equipment.clock
        self._instances, self._deterministic = equipment.instances, equipment.deterministic
        self._arrays, self._numbers = arrays, numbers
        self._channels = _given(arrays, "background").shape[0]
        self._grid = _grid(int(numbers["width"]), int(numbers["height"]))
        self._visible, self._radii = _given(outputs, "visible"), _given(outputs, "radii")
        clock = self._clock
        with clock.stage("project"):
            self._project()
        with clock.stage("sort"):
            order = self._sort_by_depth()
        with clock.stage("bin"):
            self._bin(order)
        with clock.stage("blend"):
            self._blend(outputs)

    def backward(self, gradients: Mapping[str, Tensor | bool | None]) -> None:
        """Write the gradients of the inputs, and the statistics that come with them."""
        with self._clock.stage("blend_backward"):
            sums = self._blend_backward(gradients)
        with self._clock.stage("project_backward"):
            self._project_backward(gradients, sums)

    def times(self) -> Mapping[str, tuple[float, float]]:
        """Milliseconds of each stage on the device, where they are measured."""
        return self._clock.times()

    def _project(self) -> None:
        means = _given(self._arrays, "means")
        n, width = len(means), BRUSH_CHANNELS + self._instances.width
        self._brushes = means.new_empty(n, _multiple_of_4(width))
        key = torch.int32 if means.dtype == torch.float32 else torch.int64
        self._depth_keys = means.new_empty(n, dtype=key)
        self._tile_counts = means.new_empty(n, dtype=torch.int32)
        self._job = jobs.ProjectJob(
            view=self._view(),
            splats=self._splats(),
            grid=self._grid,
            level_min=self._numbers["level_min"],
            bounded=self._numbers["alpha_min"] > 0,
            stride=self._brushes.shape[1],
            brushes=address(self._brushes),
            depth_keys=address(self._depth_keys),
            tile_counts=address(self._tile_counts),
            visible=address(self._visible),
            radii=address(self._radii),
        )
        blocks = -(-n // PROJECT_THREADS)
        self._launcher.launch(self._instances.project, blocks, PROJECT_THREADS, self._job)

    def _view(self) -> jobs.View:
        numbers = self._numbers
        names = (
            *("jacobian_margin", "dilation", "compensation_min", "alpha_min", "near", "far"),
            *("length_max", "quaternion_min_norm", "model", "antialias"),
        )
        return jobs.View(
            world_to_camera=address(self._arrays["world_to_camera"]),
            intrinsics=address(self._arrays["intrinsics"]),
            **{name: numbers[name] for name in names},
        )

    def _splats(self) -> jobs.SplatArrays:
        arrays, degree = self._arrays, int(self._numbers["sh_degree"])
        names = (
            *("means", "quats", "scales", "covariances", "opacities"),
            *("colors", "rest", "offsets", "extra"),
        )
        colors, rest = _given(arrays, "colors"), arrays["rest"]
        return jobs.SplatArrays(
            count=len(colors),
            **{name: address(arrays[name]) for name in names},
            rest_rows=0 if rest is None else len(rest),
            color_stride=colors.shape[1],
            rest_stride=_width(rest),
            extras=_width(arrays["extra"]),
            color_channels=3 if degree >= 0 else colors.shape[1],
            depth_channels=self._numbers["depth_channels"],
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
        if pairs > int(self._numbers["most_pairs"]):
            raise TooManyPairs(pairs)
        numbered = self._deterministic
        tiles = ends.new_empty(pairs, dtype=self._instances.tile_key)
        payload = ends.new_empty(pairs, dtype=torch.int32)
        rows = torch.empty_like(payload) if numbered else None
        job = jobs.EmitJob(
            grid=self._grid,
            bounded=self._job.bounded,
            stride=self._job.stride,
            brushes=self._job.brushes,
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
        """Where the pairs of each tile begin, and its chunks but the first."""
        starts = torch.empty(num_tiles + 1, dtype=torch.int64, device=tiles.device)
        job = jobs.TilesJob(address(tiles), len(tiles), num_tiles, 0, address(starts))
        blocks = -(-len(starts) // BIN_THREADS)
        self._launcher.launch(self._instances.find_tiles, blocks, BIN_THREADS, job)
        chunk = self._instances.chunk
        further = ((starts.diff() + (chunk - 1)) // chunk - 1).clamp_(min=0)
        self._tile_starts = starts
        self._chunk_starts = torch.zeros_like(starts)
        torch.cumsum(further, 0, out=self._chunk_starts[1:])

    def _blend(self, outputs: Arrays) -> None:
        image, alpha = _given(outputs, "image"), _given(outputs, "alpha")
        contribution = outputs["contribution"]
        measured = contribution
        if contribution is not None and self._slots is not None:
            measured = contribution.new_zeros(len(self._slots))
        background = self._arrays["background"]
        self._blend_job = jobs.BlendJob(
            grid=self._grid,
            **{name: self._numbers[name] for name in ("level_min", "alpha_cap", "alpha_limit")},
            transmittance_min=self._numbers["transmittance_min"],
            brushes=self._job.brushes,
            stride=self._job.stride,
            channels=self._channels,
            bounded=self._job.bounded,
            rows=address(self._pair_rows),
            tile_starts=address(self._tile_starts),
            chunk_starts=address(self._chunk_starts),
            background=address(background),
            image=address(image),
            alpha=address(alpha),
            contribution=address(measured),
            pixel_weights=address(self._arrays["pixel_weights"]),
            slots=address(self._slots),
        )
        if self._numbers["differentiated"]:
            self._keep_for_backward(alpha)
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

    def _blend_backward(self, gradients: Mapping[str, Any]) -> Tensor:
        image, alpha = gradients["image"], gradients["alpha"]
        absolute = gradients["absgrad"] is not None
        rows = len(self._pair_rows) if self._deterministic else len(self._tile_counts)
        stride = SUM_CHANNELS + self._channels + (2 if absolute else 0)
        sums = image.new_zeros(rows, stride)
        self._blend_job.image = address(gradients["drawn"])
        job = jobs.BlendBackwardJob(
            forward=self._blend_job,
            image_gradient=address(image),
            alpha_gradient=address(alpha),
            chunks=len(self._chunk_tiles),
            sums=address(sums),
            sum_stride=stride,
        )
        blocks = self._grid.columns * self._grid.rows + len(self._chunk_tiles)
        kernel = self._instances.blend_backward(absolute)
        self._launcher.launch(kernel, blocks if len(self._pair_rows) else 0, WARP, job)
        return sums

    def _project_backward(self, gradients: Mapping[str, Any], sums: Tensor) -> None:
        n = len(self._tile_counts)
        blocks = -(-n // PROJECT_THREADS)
        pose = gradients["pose"]
        poses = None if pose is None else pose.new_zeros(blocks, POSE_FIELDS)
        slot_ends = None
        if self._deterministic:
            slot_ends = torch.empty_like(self._ends)
            slot_ends[self._order] = self._ends
        names = ("means", "quats", "scales", "covariances", "opacities", "colors", "rest", "extra")
        job = jobs.ProjectBackwardJob(
            forward=self._job,
            sums=address(sums),
            sum_stride=sums.shape[1],
            channels=self._channels,
            slot_ends=address(slot_ends),
            gradients=jobs.SplatGradients(**{name: address(gradients[name]) for name in names}),
            screen_gradient=address(gradients["screen_gradient"]),
            absgrad=address(gradients["absgrad"]),
            pose=address(poses),
            accumulate=gradients["accumulate"],
        )
        kernel = self._instances.project_backward(pose is not None)
        self._launcher.launch(kernel, blocks, PROJECT_THREADS, job)
        if poses is not None:
            pose += poses.sum(0)


def _given(arrays: Arrays, name: str) -> Tensor:
    tensor = arrays[name]
    assert tensor is not None, f"{name} is always there"
    return tensor


def _grid(width: int, height: int) -> jobs.Grid:
    return jobs.Grid(width, height, -(-width // TILE), -(-height // TILE))


def _multiple_of_4(count: int) -> int:
    return -(-count // 4) * 4


def _width(tensor: Tensor | None) -> int:
    return 0 if tensor is None else tensor.shape[1]
