"""Threads: how many each of several runs may use, so that together they use the machine."""

from __future__ import annotations

import os

from gsfw.studies.origin import cores


def threads_per_run(jobs: int) -> int | None:
    """Threads of each of so many runs at a time; ``None`` leaves it as it is, for a single one."""
    if jobs == 1:
        return None
    text = os.environ.get("OMP_NUM_THREADS", "")
    available = int(text) if text.isdecimal() and int(text) > 0 else cores()
    return max(1, available // jobs)
