"""Cores: how many processors this process may use, by its affinity and its control groups."""

from __future__ import annotations

import math
import os
from functools import lru_cache

from gsfw.core.control_groups import ControlGroup, control_groups

CHOSEN = "OMP_NUM_THREADS"
"""Environment variable by which a user chooses the number of threads; torch reads it too."""
LIMITED = "GSFW_LIMITED_THREADS"
"""Value of that variable that is of this program and not of the user; processes inherit both."""


@lru_cache(maxsize=1)
def cores() -> int:
    """Cores that this process may use, at least one: a container's CPU quota counts, rounded up."""
    quotas = map(_quota_of, control_groups("cpu"))
    return min([affinity(), *(quota for quota in quotas if quota is not None)])


@lru_cache(maxsize=1)
def affinity() -> int:
    """Cores that this process may run on, whatever share of their time it gets."""
    if hasattr(os, "sched_getaffinity"):  # Not on macOS and Windows.
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def chosen_threads() -> int | None:
    """Threads that the user chose with ``OMP_NUM_THREADS``; ``None`` without a valid choice."""
    text = os.environ.get(CHOSEN, "")
    is_choice = text.isdecimal() and int(text) > 0 and text != os.environ.get(LIMITED)
    return int(text) if is_choice else None


def limit_threads() -> None:
    """Limit torch to ``cores()`` threads where a quota allows less than the affinity.

    Call it before torch is loaded, which starts a thread for each core of the machine: Linux stops
    all of them for the rest of a period once their time is used up. A user's choice stays.
    """
    if CHOSEN not in os.environ and cores() < affinity():
        os.environ[CHOSEN] = os.environ[LIMITED] = str(cores())


def _quota_of(group: ControlGroup) -> int | None:
    """The quota of a group in cores, rounded up; ``None`` where it has none.

    ``cpu.max`` of version 2 holds "QUOTA PERIOD", or "max PERIOD" for no limit. In version 1 quota
    and period have a file each; a quota of -1 is no limit.
    """
    files = ("cpu.max",) if group.version == 2 else ("cpu.cfs_quota_us", "cpu.cfs_period_us")
    words = [word for file in files for word in group.words(file)]
    if len(words) != 2 or words[0] in ("max", "-1"):
        return None
    return max(1, math.ceil(int(words[0]) / int(words[1])))
