"""Runs every kernel once on small inputs, for NVIDIA's checkers of memory and races.

    python benchmarks/gpu_kernels.py [DEVICE]

A checker slows kernels down by a factor of hundreds, those of torch as well: `gsfw bench` warms the
GPU up and counts pairs, which takes minutes then.
"""

from __future__ import annotations

import sys

import torch

from gsfw.core.operators import Operators
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.plugins.loading import choose_operators
from gsfw.plugins.registry import installed
from gsfw.studies.bench.steps import TrainingStep
from gsfw.studies.bench.workload import random_workload
from gsfw.studies.entrants import choose_on_device

RASTERIZERS = {"cuda": ("cuda", "cuda:deterministic"), "cpu": ("reference",)}
"""Rasterizers by type of device."""

SPLATS, WIDTH, HEIGHT = 500, 96, 64


def main() -> int:
    """Run everything, and wait for it."""
    device = torch.device(sys.argv[1] if len(sys.argv) > 1 else "cuda:0")
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
    _fields(operators, device)
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    sys.stdout.write("all kernels have run\n")
    return 0


def _fields(operators: Operators, device: torch.device) -> None:
    """Temporal fields with their gradients, and nearest points."""
    places = 2 * torch.rand(SPLATS, 3, device=device) - 1
    shapes = [(SPLATS, 4), (3, 8, 8, 32), (3, 8, 32), (512, 4)]
    leaves = [torch.rand(shape, device=device).requires_grad_() for shape in shapes]
    quats, planes, lines, table = leaves
    outputs = [
        operators.plane_product(places.requires_grad_(), [planes], [lines], 1.0),
        operators.hash_features(
            places.detach(), torch.full((), 0.3, device=device), [table], [(9, 3)]
        ),
        *operators.slices(quats, quats, quats),
        operators.squared_differences(planes, (1, 2), 1, 1.0),
        operators.squared_differences(lines, (1,), 2, 1.0),
        operators.mean_distance(lines, 1.0, 1.0),
    ]
    torch.stack([output.sum() for output in outputs]).sum().backward()
    operators.neighbors(places.detach(), 20)
    operators.neighbors(quats.detach(), 8)


if __name__ == "__main__":
    sys.exit(main())
