"""Machine: this machine, its GPU, and the fastest that its CPU could blend."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from importlib import metadata

import torch

from gsfw.core.loop.memory import peak_memory_mb
from gsfw.kernels.cpu.native_module import instruction_set, instruction_sets, native
from gsfw.plugins.specs import PROJECT
from gsfw.studies.origin import processor

FORWARD_OPERATIONS = 17
"""Vector operations per evaluated pixel of three channels, besides the exponential, counted in
kernels/cpu/native/blend.h: 3 for u and v, 2 for the level, compare, clamp and mask of alpha;
weight, 1 - alpha, transmittance, compare, mask, select, and one per channel."""

BACKWARD_OPERATIONS = 36
"""The same in blend_backward.h: 14 to replay alpha and weight; then 3 for the colour's pull, lift,
what lies behind, 3 for g, one per channel, 3 for u and v, and 8 for the six sums of the shape. The
sums across lanes, once per splat and tile, are left out."""

ATTEMPTS = 3
"""The best one counts: other processes make a throughput lower, never higher."""


@dataclass(frozen=True)
class Limits:
    """Throughput of one thread, with the instruction set that kernels use."""

    fma_gflops: float
    """Fused multiply-adds of float32, two operations each, in 1e9 operations per second."""
    exponential_gexp: float
    """Powers of two as in blending, in 1e9 per second."""

    @property
    def forward_ns(self) -> float:
        """Least time of blending per contributing pair, if no other pair were evaluated."""
        return self._ns(FORWARD_OPERATIONS)

    @property
    def backward_ns(self) -> float:
        """Least time of blending's backward pass per contributing pair."""
        return self._ns(BACKWARD_OPERATIONS)

    def _ns(self, operations: int) -> float:
        return operations / (0.5 * self.fma_gflops) + 1.0 / self.exponential_gexp


def measure_limits() -> Limits | None:
    """Measure in less than a second; ``None`` where the native module cannot."""
    module = native()
    fma = getattr(module, "fma_gflops", None)
    exponential = getattr(module, "exponential_gexp", None)
    if fma is None or exponential is None:
        return None
    return Limits(max(fma() for _ in range(ATTEMPTS)), max(exponential() for _ in range(ATTEMPTS)))


def machine() -> dict[str, str | int | list[str] | None]:
    """Everything besides the code that figures depend on."""
    return {
        "cpu": processor(),
        "cores": os.cpu_count(),
        "instruction_set": instruction_set(),
        "instruction_sets": instruction_sets(),
        "torch": str(torch.__version__),
        "python": platform.python_version(),
        "gsfw": metadata.version(PROJECT),
    }


def process_memory() -> float | None:
    """Peak memory of this process so far in megabytes; ``None`` where the system does not say."""
    return peak_memory_mb(torch.device("cpu")).get("rss")


def gpu(device: torch.device) -> dict[str, str | int | float] | None:
    """Name and properties of a GPU; ``None`` on the CPU."""
    if device.type != "cuda":
        return None
    properties = torch.cuda.get_device_properties(device)
    return {
        "name": properties.name,
        "memory_mb": round(properties.total_memory / 1e6),
        "multiprocessors": properties.multi_processor_count,
        "capability": f"{properties.major}.{properties.minor}",
        "cuda": str(torch.version.cuda),
    }
