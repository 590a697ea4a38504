"""Number of threads that native code may use."""

from __future__ import annotations

import math
import os
from functools import lru_cache

import torch

from gsfw.core.control_groups import ControlGroup, control_groups
from gsfw.core.cores import cores

CHOSEN = "OMP_NUM_THREADS"
"""Environment variable by which a user chooses the number of threads; torch reads it too."""


def num_threads() -> int:
    """Threads to use now, at least 1.

    As many as torch would use (``torch.set_num_threads`` and ``OMP_NUM_THREADS`` set that), but no
    more than the cores that this process may run on, nor, unless the user set ``OMP_NUM_THREADS``,
    than a container's share of CPU time is worth.
    """
    limits = [torch.get_num_threads(), _cores()]
    if CHOSEN not in os.environ:
        limits.append(_quota())
    return max(1, min(limits))


@lru_cache(maxsize=1)
def _cores() -> int:
    """Cores that this process may run on."""
    return cores()


@lru_cache(maxsize=1)
def _quota() -> int:
    """Cores that the control groups' CPU quota is worth; all of them where there is none."""
    quotas = map(_quota_of, control_groups("cpu"))
    return min((quota for quota in quotas if quota is not None), default=_cores())


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
