"""Device: what measuring asks of a GPU; everything here does nothing, or little, on the CPU."""

from __future__ import annotations

import time

import torch

from gsfw.core.loop.device import wait_for

WARM_UP_SECONDS = 1.0
WARM_UP_SIDE = 4096
"""Of the matrices that are multiplied to bring a GPU to its clocks under load."""


def mark(device: torch.device) -> torch.cuda.Event:
    """A mark in what the GPU has to do, passed once everything before it is done."""
    event = torch.cuda.Event(enable_timing=True)
    event.record(torch.cuda.current_stream(device))
    return event


def milliseconds(begin: torch.cuda.Event, end: torch.cuda.Event) -> float:
    """From one mark to another, on the GPU's clock; both must have been passed."""
    return begin.elapsed_time(end)


def begin_peak(device: torch.device) -> float:
    """Forget the peak of memory; what is allocated now, in megabytes, and 0 on the CPU."""
    if device.type != "cuda":
        return 0.0
    torch.cuda.reset_peak_memory_stats(device)
    return torch.cuda.memory_allocated(device) / 1e6


def peak_mb(device: torch.device) -> float:
    """The most that was allocated since ``begin_peak``, in megabytes, and 0 on the CPU."""
    return torch.cuda.max_memory_allocated(device) / 1e6 if device.type == "cuda" else 0.0


def warm_up(device: torch.device) -> None:
    """Keep a GPU busy for a second: an idle one runs at a fraction of its clock."""
    if device.type != "cuda":
        return
    matrix = torch.ones(WARM_UP_SIDE, WARM_UP_SIDE, device=device)
    end = time.perf_counter() + WARM_UP_SECONDS
    while time.perf_counter() < end:
        torch.mm(matrix, matrix)
        wait_for(device)


def gpu(device: torch.device) -> dict[str, str | int | float] | None:
    """What a GPU is called and has; ``None`` on the CPU."""
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
