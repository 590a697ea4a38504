"""Number of threads that native code may use."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path, PurePosixPath

import torch

from gsfw.core.cores import cores

CONTROL_GROUPS = Path("/sys/fs/cgroup")
"""Mount point of control groups in Linux, which limit the CPU time of containers."""
MEMBERSHIP = Path("/proc/self/cgroup")
"""The control groups of this process."""
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
    try:
        membership = MEMBERSHIP.read_text()
    except OSError:  # Not Linux.
        return _cores()
    return min(quotas(CONTROL_GROUPS, membership), default=_cores())


def quotas(mounted: Path, membership: str) -> Iterator[int]:
    """The CPU quotas that hold for a process, each in cores, rounded up.

    Args:
        mounted: where control groups are mounted.
        membership: ``/proc/self/cgroup``: lines ``ID:CONTROLLERS:PATH``; version 2 names none.
    """
    for line in membership.splitlines():
        _, controllers, path = line.split(":", 2)
        if controllers and "cpu" not in controllers.split(","):
            continue
        group = PurePosixPath(path.lstrip("/"))
        # A container may see its own group as the root, and limits of parents hold as well.
        for place in (group, *group.parents):
            folder = mounted / (controllers and "cpu") / place
            cores = _quota_of_1(folder) if controllers else _quota_of_2(folder)
            if cores is not None:
                yield cores


def _quota_of_2(folder: Path) -> int | None:
    """``cpu.max`` holds "QUOTA PERIOD", or "max PERIOD" for no limit."""
    words = _words(folder / "cpu.max")
    return _rounded_up(words[0], words[1]) if len(words) == 2 and words[0] != "max" else None


def _quota_of_1(folder: Path) -> int | None:
    """Quota and period have a file each; a quota of -1 is no limit."""
    quota, period = _words(folder / "cpu.cfs_quota_us"), _words(folder / "cpu.cfs_period_us")
    return _rounded_up(quota[0], period[0]) if quota and period and quota[0] != "-1" else None


def _rounded_up(quota: str, period: str) -> int:
    return max(1, math.ceil(int(quota) / int(period)))


def _words(path: Path) -> list[str]:
    try:
        return path.read_text().split()
    except OSError:
        return []
