"""Peak memory of this process, and of its GPU."""

from __future__ import annotations

import sys

import torch


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


def memory_summary(device: torch.device) -> dict[str, float]:
    """The peaks as a run's summary has them, of the GPU only where one is used."""
    peaks = peak_memory_mb(device)
    summary = {"peak_memory_mb": round(peaks.get("rss", 0.0), 1)}
    if "cuda" in peaks:
        summary["peak_gpu_memory_mb"] = round(peaks["cuda"], 1)
    return summary
