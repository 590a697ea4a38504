"""Peak memory of this process."""

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
