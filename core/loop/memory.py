"""Peak memory of this process and of its GPU: over its life, and over a piece of work."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from pathlib import Path

import torch

CLEAR_REFS, STATUS = Path("/proc/self/clear_refs"), Path("/proc/self/status")
"""Where Linux takes orders about the memory of this process, and tells of it (proc(5))."""


def peak_memory_mb(device: torch.device) -> dict[str, float]:
    """Peak resident memory ("rss"), and peak allocations on a GPU ("cuda") where one is used.

    In megabytes; where the system does not say (Windows), "rss" is left out.
    """
    peaks: dict[str, float] = {}
    if sys.platform != "win32":
        import resource

        unit = 1 if sys.platform == "darwin" else 1024
        peaks["rss"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
    if device.type == "cuda":
        peaks["cuda"] = torch.cuda.max_memory_allocated(device) / 1e6
    return peaks


def added_memory_mb(work: Callable[[], object], device: torch.device) -> float | None:
    """Do ``work``; how much memory it takes at most, beyond what is held before it.

    On a GPU what torch allocates there, on the CPU what of the process is resident. Peaks that are
    asked for later, by ``peak_memory_mb`` too, count from here on.

    Args:
        work: is called once, whether its memory can be measured or not.
        device: where it happens.

    Returns:
        Megabytes (1e6 bytes); ``None`` where the system does not say: on the CPU that is all but
        Linux, and on any other device than a CUDA one.
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


def _forget_peak() -> bool:
    """Let the peak of resident memory count anew; whether that is possible."""
    if not CLEAR_REFS.exists():
        return False
    # What glibc keeps of freed memory for later is resident, and its use would not be seen.
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
    try:
        CLEAR_REFS.write_text("5")
    except OSError:
        return False
    return True


def _status_mb(name: str) -> float | None:
    """A line of the process's status, in megabytes; ``None`` where there is no such line."""
    lines = dict(line.split(":", 1) for line in STATUS.read_text().splitlines())
    return int(lines[name].split()[0]) * 1024 / 1e6 if name in lines else None


def memory_summary(device: torch.device) -> dict[str, float]:
    """The peaks as a run's summary has them, of the GPU only where one is used."""
    peaks = peak_memory_mb(device)
    summary = {"peak_memory_mb": round(peaks.get("rss", 0.0), 1)}
    if "cuda" in peaks:
        summary["peak_gpu_memory_mb"] = round(peaks["cuda"], 1)
    return summary
