"""Machine memory: what this process may have, by the machine, its control groups and its GPU.

Past the limit of a control group Linux ends a process without a word. The limits of an address
space and of data (``RLIMIT_AS``, ``RLIMIT_DATA``) are no part of this: they count what is only
reserved, of which torch has gigabytes, and the system refuses what is beyond them with an error.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

import torch

from gsfw.core.control_groups import ControlGroup, control_groups
from gsfw.core.words import size

STATUS, MACHINE = Path("/proc/self/status"), Path("/proc/meminfo")
"""Linux reports the memory of this process, and that of the machine, here (proc(5))."""
LIMITS = {1: "memory.limit_in_bytes", 2: "memory.max"}
USED = {1: "memory.usage_in_bytes", 2: "memory.current"}
"""Files of a control group by its version: its limit, and what its processes have."""
CACHED = {
    1: ("total_active_file", "total_inactive_file"),
    2: ("active_file", "inactive_file", "slab_reclaimable"),
}
"""Lines of its memory.stat with cached files, which make room when it is needed."""
SWAP_LIMITS = {1: "memory.memsw.limit_in_bytes", 2: "memory.swap.max"}
"""Files of the limit of swapped memory; that of version 1 counts main memory too."""

MOSTLY = 0.9
"""Part of a limit above which the rest is not worth a word."""


class Limit(Enum):
    """A limit of memory, as the beginning of a sentence."""

    MACHINE = "this machine has"
    GROUP = "the control group of this process allows"
    GPU = "its GPU has"


@dataclass(frozen=True)
class MachineMemory:
    """The memory that one limit leaves to this process; in bytes."""

    allowed: int
    """Memory that the limit allows to all its processes together."""
    free: int
    """Memory that no process has."""
    own: int = 0
    """Memory that this process has already."""
    swap: int = 0
    """Further memory on disk: a process that needs it goes on, many times slower."""
    limit: Limit = Limit.MACHINE
    processes: int = 1
    """Processes that grow alike: ``free`` and ``swap`` are the part of one of them."""

    @property
    def room(self) -> int:
        """Memory that this process may have in all."""
        return self.free + self.own

    @property
    def fair(self) -> float:
        """The part of one process in what is allowed to all, in bytes."""
        return self.allowed / self.processes

    def shared_by(self, processes: int) -> MachineMemory:
        """The memory of one of several processes that grow alike."""
        free, swap = self.free // processes, self.swap // processes
        return replace(self, free=free, swap=swap, processes=processes)

    def __str__(self) -> str:
        """The limit, and what others leave of it: "this machine has 8.0 GB, of which ..."."""
        left = "" if self.room > MOSTLY * self.allowed else f", of which {size(self.room)} are left"
        return f"{self.limit.value} {size(self.allowed)}{left}"


def machine_memory() -> MachineMemory | None:
    """The tightest limit of this process; ``None`` where the system does not tell (Windows)."""
    return min(memory_limits(), key=lambda memory: memory.room + memory.swap, default=None)


def free_memory() -> float:
    """Bytes of main memory that no process has; infinite where the system does not tell."""
    memory = machine_memory()
    return math.inf if memory is None else float(memory.free)


def process_memory() -> MachineMemory | None:
    """The part of ``machine_memory`` of one of the processes that torchrun starts together."""
    memory, processes = machine_memory(), int(os.environ.get("LOCAL_WORLD_SIZE", "1"))
    return None if memory is None else memory.shared_by(processes)


def gpu_memory(device: torch.device) -> MachineMemory:
    """The memory of a GPU; memory that torch keeps for later tensors counts as free.

    Args:
        device: a CUDA device.
    """
    free, allowed = torch.cuda.mem_get_info(device)
    own = torch.cuda.memory_allocated(device)
    return MachineMemory(
        allowed, free + torch.cuda.memory_reserved(device) - own, own, limit=Limit.GPU
    )


def memory_limits() -> list[MachineMemory]:
    """The memory of the machine, and then every limit of a control group below it."""
    machine = _machine()
    return [] if machine is None else [machine, *_groups(machine)]


def _machine() -> MachineMemory | None:
    """The memory of the machine."""
    found = kernel_sizes(MACHINE)
    if "MemAvailable" in found:
        total, free = found["MemTotal"], found["MemAvailable"]
        return MachineMemory(total, free, anonymous_memory(), found.get("SwapFree", 0))
    try:  # macOS tells its size alone.
        total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return None
    return MachineMemory(total, total) if total > 0 else None


def _groups(machine: MachineMemory) -> Iterator[MachineMemory]:
    """The limits of the control groups of this process that are below the machine's memory."""
    for group in control_groups("memory"):
        limit = group.number(LIMITS[group.version])
        if limit is None or limit >= machine.allowed:  # Version 1 has a huge one for none.
            continue
        # Memory that this process had before it joined the group counts for another one.
        own = min(machine.own, _used(group))
        free, swap = limit - _used(group), min(machine.swap, _swap(group, limit))
        yield MachineMemory(limit, max(free, 0), own, swap, Limit.GROUP)


def _used(group: ControlGroup) -> int:
    """Memory of the processes of a group, without cached files; 0 where it is unknown."""
    lines = group.words("memory.stat")
    stat = dict(zip(lines[::2], map(int, lines[1::2]), strict=False))
    used = group.number(USED[group.version]) or 0
    return max(used - sum(stat.get(name, 0) for name in CACHED[group.version]), 0)


def _swap(group: ControlGroup, limit: int) -> int:
    """Swapped memory that a group may have; as much as there is where it has no limit of it."""
    most = group.number(SWAP_LIMITS[group.version])
    if most is None:
        return 1 << 62
    return max(most - limit, 0) if group.version == 1 else most


def anonymous_memory(status: Path | None = None) -> int:
    """Memory of a process that nothing else can use, without cached files, in bytes.

    Args:
        status: the kernel's file of the process, as /proc/PID/status; ``None`` for this process.

    Returns:
        0 where the system does not tell, or the process has ended.
    """
    return kernel_sizes(status or STATUS).get("RssAnon", 0)


def kernel_sizes(path: Path) -> dict[str, int]:
    """The lines of a file of the kernel that are sizes ("MemTotal:  24684216 kB"), in bytes."""
    try:
        lines = [line.split() for line in path.read_text().splitlines()]
    except OSError:  # Not Linux.
        return {}
    return {
        words[0].rstrip(":"): int(words[1]) * 1024
        for words in lines
        if len(words) == 3 and words[2] == "kB"
    }
