"""Nearest points on the GPU."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.kernels.cuda import step_jobs
from gsfw.kernels.cuda.instances import NAMES
from gsfw.kernels.cuda.launcher import Kernel, Launcher, address, blocks_for

AXES = (3, 4)
"""Numbers of coordinates that the kernel is compiled for."""

WIDTHS = (8, 16, 24, 32)
"""Numbers of neighbours that the kernel is compiled for; others are the nearest of more."""

MOST_POINTS = {torch.float32: 1_000_000, torch.float64: 100_000}
"""More points are left to the host, whose time grows less than that of all pairs: some 0.4 s of an
H200 by count of instructions. Float64 takes up to 64 times as long."""

MOST_PAIRS = {torch.float32: 2**36, torch.float64: 2**31}
"""Pairs of points in one launch. Drivers that also show a screen end a kernel after two seconds: by
count of operations these take 0.3 s on a GPU of 14 multiprocessors, and 0.5 s in float64."""


def can_find(points: Tensor, k: int) -> bool:
    """True if the kernel finds ``k`` neighbours of such points."""
    count, axes = points.shape
    return axes in AXES and 0 < k <= WIDTHS[-1] and 0 < count <= MOST_POINTS[points.dtype]


def neighbors_kernel(dtype: torch.dtype, axes: int, k: int) -> Kernel:
    """The instance for ``k`` neighbours of points with so many coordinates."""
    width = next(width for width in WIDTHS if width >= k)
    return Kernel("neighbors.cu", f"neighbors<{NAMES[dtype]}, {axes}, {width}>")


def neighbors(points: Float[Tensor, "p d"], k: int, launcher: Launcher) -> Int[Tensor, "p k"]:
    """``Operators.neighbors`` for points of ``can_find``; the host does not wait."""
    points = points.detach().contiguous()
    count, axes = points.shape
    rows = torch.empty(count, k, dtype=torch.int64, device=points.device)
    kernel, threads = neighbors_kernel(points.dtype, axes, k), step_jobs.NEIGHBOR_THREADS
    at_once = max(MOST_PAIRS[points.dtype] // count, threads)
    for first in range(0, count, at_once):
        end = min(first + at_once, count)
        job = step_jobs.NeighborsJob(
            points=address(points),
            rows=address(rows),
            count=count,
            wanted=k,
            first=first,
            end=end,
        )
        launcher.launch(kernel, blocks_for(end - first, threads), threads, job)
    return rows
