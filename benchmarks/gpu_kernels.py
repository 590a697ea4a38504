"""Runs every kernel once on small inputs, for NVIDIA's checkers of memory and races.

    python benchmarks/gpu_kernels.py [DEVICE [overrun]]

A checker slows kernels down by a factor of hundreds, those of torch as well: `gsfw bench` warms the
GPU up and counts pairs, which takes minutes then. With `overrun`, a kernel writes beyond its memory
instead: a checker that does not see that sees nothing.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator

import torch
from torch import Tensor

from gsfw.core.operators import Operators
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.kernels.cuda.cuda_launcher import cuda_launcher
from gsfw.kernels.cuda.launcher import address
from gsfw.kernels.cuda.neighbors import WIDTHS, neighbors_kernel
from gsfw.kernels.cuda.step_jobs import NEIGHBOR_THREADS, NeighborsJob
from gsfw.plugins.loading import choose_operators
from gsfw.plugins.registry import installed
from gsfw.studies.bench.steps import TrainingStep
from gsfw.studies.bench.workload import random_workload
from gsfw.studies.entrants import choose_on_device

RASTERIZERS = {"cuda": ("cuda", "cuda:deterministic"), "cpu": ("reference",)}
"""Rasterizers by type of device."""

SPLATS, WIDTH, HEIGHT = 500, 96, 64

ROWS = 501
"""Rows of fields: no multiple of what a warp or a block takes."""

SIDES, CHANNELS = (2, 7), 33
"""Planes of a field: two resolutions, and one channel more than a warp has threads."""

HASH_SIZES, HASH_ROWS = [(3, 2), (30, 9)], (54, 16)
"""Two tables of a hash grid: one with a row for each corner, and one with a hash."""

MANY_NUMBERS = 4096 * 257 + 5
"""Numbers of a grid whose sums take more than one block to add."""


def main() -> int:
    """Run everything, and wait for it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("device", nargs="?", type=torch.device, default="cuda:0")
    parser.add_argument("overrun", nargs="?", choices=["overrun"])
    given = parser.parse_args()
    device = given.device
    if given.overrun:
        overrun(device)
        return 0
    images_and_steps(device)
    operators = choose_operators(installed(), device)
    torch.stack(list(field_values(operators, device))).sum().backward()
    nearest(operators, device)
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    sys.stdout.write("all kernels have run\n")
    return 0


def images_and_steps(device: torch.device) -> None:
    """Images of all outputs with their gradients, and training steps."""
    registry = installed()
    entrants = choose_on_device(RASTERIZERS[device.type], str(device), registry, {})
    operators = choose_operators(registry, device)
    workload = random_workload(f"random:{SPLATS}", device).sized(WIDTH, HEIGHT)
    steps = [TrainingStep(workload, operators, sparse) for sparse in (False, True)]
    everything = RenderSettings(depth=Depth.EXPECTED, statistics=frozenset(Statistic))
    for entrant in entrants:
        splats = workload.splats.map(lambda tensor: tensor.clone().requires_grad_())
        output = entrant.rasterizer.render(splats, workload.cameras, everything)
        (output.color.sum() + output.depth.sum()).backward()
        for step in steps:
            step.run(entrant.rasterizer, entrant.settings)


def field_values(operators: Operators, device: torch.device) -> Iterator[Tensor]:
    """Sums of temporal fields, their slices and regularizers, with and without some gradients."""

    def leaf(*shape: int) -> Tensor:
        return torch.rand(shape, device=device).requires_grad_()

    # A field is asked beyond its borders, and a model may hold any number.
    places = 2.4 * torch.rand(ROWS, 3, device=device) - 1.2
    places[0], places[1] = math.nan, math.inf
    planes = [leaf(3, side, side, CHANNELS) for side in SIDES]
    lines = [leaf(3, side, CHANNELS) for side in SIDES]
    for one in (places, places.clone().requires_grad_()):
        yield operators.plane_product(one, planes, lines, 1.0)[2:].sum()
    time = torch.full((), 0.3, device=device)
    for channels in (1, 2, 4):
        tables = [leaf(rows, channels) for rows in HASH_ROWS]
        yield operators.hash_features(places, time, tables, HASH_SIZES).sum()
        tables[0] = tables[0].detach()
        yield operators.hash_features(places, time, tables, HASH_SIZES).sum()
    quats = leaf(ROWS, 4)
    yield from (values.sum() for values in operators.slices(quats, quats, quats))
    grid = leaf(3, 37, 41, 3)
    for axes, order in (((1,), 1), ((1, 2), 1), ((2,), 2)):
        yield operators.squared_differences(grid, axes, order, 1.0)
    yield operators.mean_distance(leaf(MANY_NUMBERS), 1.0, 1.0)


def nearest(operators: Operators, device: torch.device) -> None:
    """Nearest points, by every instance of the kernel, and of fewer points than are asked for."""
    for axes in (3, 4):
        points = torch.rand(ROWS, axes, device=device)
        for width in WIDTHS:
            operators.neighbors(points, width - 1)
        operators.neighbors(points[:5], 20)


def overrun(device: torch.device) -> None:
    """Let a kernel write one row beyond its memory."""
    points = torch.rand(ROWS, 3, device=device)
    rows = torch.empty(ROWS - 1, 8, dtype=torch.int64, device=device)
    job = NeighborsJob(
        points=address(points),
        rows=address(rows),
        count=ROWS,
        wanted=8,
        first=0,
        end=ROWS,
    )
    kernel = neighbors_kernel(points.dtype, 3, 8)
    cuda_launcher(device).launch(kernel, 2, NEIGHBOR_THREADS, job)
    torch.cuda.synchronize(device)


if __name__ == "__main__":
    sys.exit(main())
