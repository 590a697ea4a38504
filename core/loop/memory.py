"""Peak memory of this process and of its GPU: over its life, and over a piece of work."""

from __future__ import annotations

import ctypes
import gc
import sys
from collections.abc import Callable
from pathlib import Path

import torch

from gsfw.core.machine_memory import STATUS, kernel_sizes

CLEAR_REFS = Path("/proc/self/clear_refs")
"""Linux resets the peak memory of this process here (proc(5))."""


def peak_memory_mb(device: torch.device) -> dict[str, float]:
    """Peak resident memory ("rss"), and peak allocations on a GPU ("cuda") where one is used.

    In megabytes; "rss" is absent if the system does not report it (Windows).
    """
    peaks: dict[str, float] = {}
    resident = _peak_resident_mb()
    if resident is not None:
        peaks["rss"] = resident
    if device.type == "cuda":
        peaks["cuda"] = torch.cuda.max_memory_allocated(device) / 1e6
    return peaks


def _peak_resident_mb() -> float | None:
    """Peak resident memory of this process; ``None`` if the system does not report it."""
    if sys.platform == "win32":
        return None
    # getrusage of Linux counts the process that started this one, too: until exec, its memory is
    # that of this process.
    if (peak := _status_mb("VmHWM")) is not None:
        return peak
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def added_memory_mb(work: Callable[[], object], device: torch.device) -> float | None:
    """Run ``work``, and measure the most memory that it needs beyond the memory in use before it.

    On a GPU this is torch's allocations, on the CPU the resident memory of the process. Later
    peaks, those of ``peak_memory_mb`` too, count from here on.

    Args:
        work: called once, even if its memory cannot be measured.
        device: device of the work.

    Returns:
        Megabytes (1e6 bytes); ``None`` if the system does not report them: on the CPU of systems
        other than Linux, and on any other device than a CUDA one.
    """
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
        allocated = torch.cuda.memory_allocated(device)
        work()
        return (torch.cuda.max_memory_allocated(device) - allocated) / 1e6
    known = device.type == "cpu" and _forget_peak()
    before = _status_mb("VmRSS") if known else None
    work()
    after = _status_mb("VmHWM") if known else None
    return None if before is None or after is None else max(0.0, after - before)


def release_freed_memory() -> None:
    """Give freed memory back to the system; glibc keeps what lies between things that stay."""
    if sys.platform == "win32":  # Its allocator has no such call.
        return
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def _forget_peak() -> bool:
    """Reset the peak of resident memory; true if the system can."""
    if not CLEAR_REFS.exists():
        return False
    # Freed memory that stays resident would be used and not be measured, and garbage that Python
    # collects during the work would count against it.
    gc.collect()
    release_freed_memory()
    try:
        CLEAR_REFS.write_text("5")
    except OSError:
        return False
    return True


def _status_mb(name: str) -> float | None:
    """Read a line of the process's status, in megabytes; ``None`` if there is no such line."""
    found = kernel_sizes(STATUS).get(name)
    return None if found is None else found / 1e6


def memory_summary(device: torch.device) -> dict[str, float]:
    """Memory peaks for a run's summary; those of the GPU only if one is used."""
    peaks = peak_memory_mb(device)
    summary = {"peak_memory_mb": round(peaks.get("rss", 0.0), 1)}
    if "cuda" in peaks:
        summary["peak_gpu_memory_mb"] = round(peaks["cuda"], 1)
    return summary
