"""Temporal fields in CUDA kernels: products of planes, hash grids, and slices.

In the backward pass rows whose incoming gradient is zero (no pixel shows them) are left out. The
gradients of cells are sums of atomics, in no fixed order; see ``ordered``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from gsfw.core.maths.slices import Slices
from gsfw.core.operators import Operators
from gsfw.kernels.cuda import field_jobs
from gsfw.kernels.cuda.instances import HASH_WIDTHS, kernel_of
from gsfw.kernels.cuda.launcher import Launcher, address, blocks_for
from gsfw.kernels.cuda.step_jobs import WARP

INDEX_LIMIT = 2**31
"""Numbers of a table that kernels index are fewer."""

MOST_CORNERS = 2**24
"""Corners along an axis of a hash grid; float32 counts no further."""

ALIGNED_NUMBERS = 64
"""Each gradient of several in one allocation begins at a multiple of so many numbers."""

WARPS = field_jobs.PLANE_THREADS // WARP
"""Places of a block of ``plane_product``."""


def ordered() -> bool:
    """True if torch is told to use deterministic algorithms: sums without order are left to it."""
    return torch.are_deterministic_algorithms_enabled()


def fits_planes(
    places: Float[Tensor, "n 3"],
    planes: Sequence[Float[Tensor, "3 _ _ d"]],
    lines: Sequence[Float[Tensor, "3 _ d"]],
) -> bool:
    """True if ``plane_product`` takes tensors of these shapes."""
    channels = planes[0].shape[-1]
    alike = len(planes) == len(lines) <= field_jobs.PLANE_LEVELS and all(
        plane.shape == (3, line.shape[1], line.shape[1], channels)
        and line.shape == (3, line.shape[1], channels)
        and line.shape[1] > 1
        and plane.numel() < INDEX_LIMIT
        for plane, line in zip(planes, lines, strict=True)
    )
    return alike and channels > 0 and len(places) > 0 and places.shape[1] == 3


def plane_product(
    launcher: Launcher,
    places: Float[Tensor, "n 3"],
    planes: Sequence[Float[Tensor, "3 _ _ d"]],
    lines: Sequence[Float[Tensor, "3 _ d"]],
    scale: float,
) -> Float[Tensor, "n f"]:
    """``Operators.plane_product`` for tensors that fit."""
    features: Tensor = _PlaneProduct.apply(launcher, places, scale, *planes, *lines)
    return features


def fits_tables(
    places: Float[Tensor, "n 3"],
    time: Float[Tensor, ""],
    tables: Sequence[Float[Tensor, "_ d"]],
    sizes: Sequence[tuple[int, int]],
) -> bool:
    """True if ``hash_features`` takes tensors of these shapes."""
    channels = tables[0].shape[1]
    alike = len(tables) == len(sizes) <= field_jobs.HASH_LEVELS and all(
        table.shape[1] == channels
        and 0 < table.numel() < INDEX_LIMIT
        and min(size) >= 2
        and max(size) <= MOST_CORNERS
        for table, size in zip(tables, sizes, strict=True)
    )
    numbers = len(places) * len(tables) * channels
    return alike and 0 < numbers < INDEX_LIMIT and places.shape[1] == 3 and time.numel() == 1


def hash_features(
    launcher: Launcher,
    places: Float[Tensor, "n 3"],
    time: Float[Tensor, ""],
    tables: Sequence[Float[Tensor, "_ d"]],
    sizes: Sequence[tuple[int, int]],
) -> Float[Tensor, "n f"]:
    """``Operators.hash_features`` for tensors that fit."""
    given = (places.detach(), time.detach().to(places))
    features: Tensor = _HashFeatures.apply(launcher, *given, tuple(sizes), *tables)
    return features


def slices(
    launcher: Launcher,
    left: Float[Tensor, "n 4"],
    right: Float[Tensor, "n 4"],
    scales: Float[Tensor, "n 4"],
) -> Slices:
    """``Operators.slices`` for at least one row."""
    return Slices(*_Slices.apply(launcher, left, right, scales))


class _PlaneProduct(torch.autograd.Function):
    """Interpolates six factors and multiplies them; backward interpolates them again."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch has no type for it
        launcher: Launcher,
        places: Tensor,
        scale: float,
        *tables: Tensor,
    ) -> Tensor:
        places, tables = places.contiguous(), tuple(table.contiguous() for table in tables)
        job = _plane_job(places, tables, scale)
        features = places.new_empty(len(places), job.level_count * job.channels)
        job.features = address(features)
        kernel = kernel_of("plane_product.cu", "plane_product", places.dtype)
        launcher.launch(kernel, blocks_for(len(places), WARPS), field_jobs.PLANE_THREADS, job)
        ctx.save_for_backward(places, *tables)
        ctx.launcher, ctx.scale = launcher, scale
        return features

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        places, *tables = ctx.saved_tensors
        gradient = gradient.contiguous()
        to_places = torch.empty_like(places) if ctx.needs_input_grad[1] else None
        to_tables = _zeros_like(tables, ctx.needs_input_grad[3:])
        job = field_jobs.PlaneProductBackwardJob(
            forward=_plane_job(places, tables, ctx.scale),
            gradient=address(gradient),
            places=address(to_places),
        )
        levels = len(tables) // 2
        for level in range(levels):
            planes, lines = to_tables[level], to_tables[levels + level]
            job.levels[level] = field_jobs.PlaneGradients(address(planes), address(lines))
        kernel = kernel_of("plane_product.cu", "plane_product_backward", places.dtype)
        blocks = blocks_for(len(places), WARPS)
        ctx.launcher.launch(kernel, blocks, field_jobs.PLANE_THREADS, job)
        return None, to_places, None, *to_tables


class _HashFeatures(torch.autograd.Function):
    """Interpolates rows of tables; backward finds the rows again."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch has no type for it
        launcher: Launcher,
        places: Tensor,
        time: Tensor,
        sizes: tuple[tuple[int, int], ...],
        *tables: Tensor,
    ) -> Tensor:
        places, tables = places.contiguous(), tuple(table.contiguous() for table in tables)
        job = _hash_job(places, time, tables, sizes)
        features = places.new_empty(len(places), job.level_count * job.channels)
        job.features = address(features)
        width = _width(job.channels, [features, *tables])
        kernel = kernel_of("hash_features.cu", "hash_features", places.dtype, width)
        blocks = blocks_for(features.numel() // width, field_jobs.HASH_THREADS)
        launcher.launch(kernel, blocks, field_jobs.HASH_THREADS, job)
        ctx.save_for_backward(places, time, *tables)
        ctx.launcher, ctx.sizes, ctx.width = launcher, sizes, width
        return features

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        places, time, *tables = ctx.saved_tensors
        gradient = gradient.contiguous()  # Read number by number, so that it may lie anywhere.
        to_tables = _zeros_like(tables, ctx.needs_input_grad[4:])
        job = field_jobs.HashBackwardJob(
            forward=_hash_job(places, time, tables, ctx.sizes), gradient=address(gradient)
        )
        for level, table in enumerate(to_tables):
            job.tables[level] = address(table)
        kernel = kernel_of("hash_features.cu", "hash_features_backward", places.dtype, ctx.width)
        blocks = blocks_for(gradient.numel() // ctx.width, field_jobs.HASH_THREADS)
        ctx.launcher.launch(kernel, blocks, field_jobs.HASH_THREADS, job)
        return None, None, None, None, *to_tables


def _hash_job(
    places: Tensor, time: Tensor, tables: Sequence[Tensor], sizes: Sequence[tuple[int, int]]
) -> field_jobs.HashJob:
    """The job of tables, by resolution; without features."""
    job = field_jobs.HashJob(
        places=address(places),
        time=address(time),
        count=len(places),
        level_count=len(tables),
        channels=tables[0].shape[1],
    )
    for level, (table, (side, times)) in enumerate(zip(tables, sizes, strict=True)):
        rows = len(table)
        dense = side**3 * times <= rows
        job.levels[level] = field_jobs.HashLevel(address(table), rows, side, times, dense)
    return job


def _width(channels: int, tensors: Sequence[Tensor]) -> int:
    """Channels of a thread: they divide all, and lie at multiples of their number in memory."""
    size = tensors[0].element_size()
    return next(
        width
        for width in HASH_WIDTHS
        if channels % width == 0 and all(t.data_ptr() % (width * size) == 0 for t in tensors)
    )


class _Slices(torch.autograd.Function):
    """Slices rows; backward slices them again."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch has no type for it
        launcher: Launcher,
        *given: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor]:
        dense = [tensor.contiguous() for tensor in given]
        count = len(dense[0])
        covariances = dense[0].new_empty(count, 3, 3)
        velocities, variances = covariances.new_empty(count, 3), covariances.new_empty(count)
        job = _slice_job(dense)
        job.covariances, job.velocities = address(covariances), address(velocities)
        job.variances = address(variances)
        kernel = kernel_of("slice.cu", "slice", dense[0].dtype)
        blocks = blocks_for(count, field_jobs.SLICE_THREADS)
        launcher.launch(kernel, blocks, field_jobs.SLICE_THREADS, job)
        ctx.save_for_backward(*given)
        ctx.launcher = launcher
        return covariances, velocities, variances

    @staticmethod
    def backward(ctx: Any, *arriving: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        given = ctx.saved_tensors
        if torch.is_grad_enabled():  # These gradients are to be differentiated again.
            wanted = [tensor for tensor in given if tensor.requires_grad]
            slices = Operators().slices(*given)
            again = iter(torch.autograd.grad(slices, wanted, arriving, create_graph=True))
            return None, *(next(again) if tensor.requires_grad else None for tensor in given)
        dense = [tensor.contiguous() for tensor in given]
        flows = [gradient.contiguous() for gradient in arriving]
        found = [torch.empty_like(tensor) for tensor in dense]
        job = field_jobs.SliceBackwardJob(_slice_job(dense), *map(address, (*flows, *found)))
        kernel = kernel_of("slice.cu", "slice_backward", dense[0].dtype)
        blocks = blocks_for(len(dense[0]), field_jobs.SLICE_THREADS)
        ctx.launcher.launch(kernel, blocks, field_jobs.SLICE_THREADS, job)
        return None, *found


def _slice_job(given: Sequence[Tensor]) -> field_jobs.SliceJob:
    """The job of left and right quaternions and scales; without slices."""
    left, right, scales = map(address, given)
    return field_jobs.SliceJob(left=left, right=right, scales=scales, count=len(given[0]))


def _plane_job(
    places: Tensor, tables: Sequence[Tensor], scale: float
) -> field_jobs.PlaneProductJob:
    """The job of planes, and then lines, by resolution; without features."""
    count = len(tables) // 2
    job = field_jobs.PlaneProductJob(
        places=address(places),
        count=len(places),
        scale=scale,
        level_count=count,
        channels=tables[0].shape[-1],
    )
    for level, (planes, lines) in enumerate(zip(tables[:count], tables[count:], strict=True)):
        job.levels[level] = field_jobs.PlaneLevel(address(planes), address(lines), lines.shape[1])
    return job


def _zeros_like(tables: Sequence[Tensor], wanted: Sequence[bool]) -> list[Tensor | None]:
    """Zeros in the shape of each table that is wanted, set by one operation for all."""
    sizes = [
        blocks_for(table.numel(), ALIGNED_NUMBERS) * ALIGNED_NUMBERS if want else 0
        for table, want in zip(tables, wanted, strict=True)
    ]
    parts = tables[0].new_zeros(sum(sizes)).split(sizes)
    return [
        part[: table.numel()].view(table.shape) if want else None
        for part, table, want in zip(parts, tables, wanted, strict=True)
    ]
