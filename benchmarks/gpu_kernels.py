"""Runs the kernels of a step once on small inputs, for NVIDIA's checkers of memory and races.

    python benchmarks/gpu_kernels.py [DEVICE]

A checker slows kernels down by a factor of hundreds, those of torch as well: `gsfw bench` warms the
GPU up and counts pairs, which takes minutes then.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import torch

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
    everything = replace(RenderSettings(), depth=Depth.EXPECTED, statistics=frozenset(Statistic))
    for entrant in entrants:
        splats = workload.splats.map(lambda tensor: tensor.clone().requires_grad_())
        output = entrant.rasterizer.render(splats, workload.cameras, everything)
        (output.color.sum() + output.depth.sum()).backward()
        for step in steps:
            step.run(entrant.rasterizer, entrant.settings)
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    sys.stdout.write("all kernels have run\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
