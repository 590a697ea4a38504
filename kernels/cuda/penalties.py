"""Regularisers of grids in CUDA kernels: two launches for a value, and one for its gradient."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.maths.variation import four_axes
from gsfw.core.operators import Operators
from gsfw.kernels.cuda import field_jobs
from gsfw.kernels.cuda.instances import kernel_of
from gsfw.kernels.cuda.launcher import Launcher, address, blocks_for

COUNT_LIMIT = 2**31
"""Numbers that a grid must be smaller than."""

SOURCE = "grid_variation.cu"
"""File of all these kernels."""

Job = field_jobs.GridVariationJob | field_jobs.GridDistanceJob


def squared_differences(
    launcher: Launcher,
    grid: Float[Tensor, "*cells"],
    axes: Sequence[int],
    order: int,
    weight: float,
) -> Float[Tensor, ""] | None:
    """``Operators.squared_differences``; ``None`` for axes that kernels do not take."""
    cells = four_axes(grid.shape, [axis % grid.dim() for axis in axes], order)
    if cells is None:
        return None
    _, first, second, inner = cells
    sizes = [grid.numel() * max(n - order, 0) // n for n in (first, second)]
    weights = [weight / size if size > 0 else 0.0 for size in sizes]
    job = field_jobs.GridVariationJob(
        first=field_jobs.GridAxis(first, second * inner, weights[0]),
        second=field_jobs.GridAxis(second, inner, weights[1]),
        order=order,
    )

    def plain(values: Tensor) -> Tensor:
        return Operators().squared_differences(values, axes, order, weight)

    found: Tensor = _Penalty.apply(launcher, "grid_variation", job, plain, grid)
    return found


def mean_distance(
    launcher: Launcher, values: Float[Tensor, "*cells"], center: float, weight: float
) -> Float[Tensor, ""]:
    """``Operators.mean_distance``."""
    job = field_jobs.GridDistanceJob(center=center, weight=weight / values.numel())

    def plain(values: Tensor) -> Tensor:
        return Operators().mean_distance(values, center, weight)

    found: Tensor = _Penalty.apply(launcher, "grid_distance", job, plain, values)
    return found


class _Penalty(torch.autograd.Function):
    """A scalar of one tensor; backward reads the tensor again."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch has no type for it
        launcher: Launcher,
        name: str,
        job: Job,
        plain: Callable[[Tensor], Tensor],
        values: Tensor,
    ) -> Tensor:
        dense = values.contiguous()
        blocks = blocks_for(dense.numel(), field_jobs.GRID_NUMBERS)
        sums, value = dense.new_empty(blocks, dtype=torch.float64), dense.new_empty(())
        job.grid = field_jobs.GridNumbers(
            values=address(dense), count=dense.numel(), sums=address(sums)
        )
        measure = kernel_of(SOURCE, name, dense.dtype)
        launcher.launch(measure, blocks, field_jobs.GRID_THREADS, job)
        parts = field_jobs.PenaltyJob(sums=address(sums), blocks=blocks, value=address(value))
        add = kernel_of(SOURCE, "add_penalty", dense.dtype)
        launcher.launch(add, 1, field_jobs.GRID_THREADS, parts)
        ctx.save_for_backward(values)
        ctx.launcher, ctx.name, ctx.job, ctx.plain = launcher, name, job, plain
        return value

    @staticmethod
    def backward(ctx: Any, arriving: Tensor) -> tuple[None, None, None, None, Tensor]:  # noqa: ANN401
        (values,) = ctx.saved_tensors
        if torch.is_grad_enabled():  # This gradient is to be differentiated again.
            (again,) = torch.autograd.grad(ctx.plain(values), values, arriving, create_graph=True)
            return None, None, None, None, again
        dense, job = values.contiguous(), ctx.job
        gradient = torch.empty_like(dense)
        job.grid = field_jobs.GridNumbers(
            values=address(dense),
            count=dense.numel(),
            arriving=address(arriving),
            gradient=address(gradient),
        )
        kernel = kernel_of(SOURCE, f"{ctx.name}_backward", dense.dtype)
        blocks = blocks_for(dense.numel(), field_jobs.GRID_NUMBERS)
        ctx.launcher.launch(kernel, blocks, field_jobs.GRID_THREADS, job)
        return None, None, None, None, gradient
