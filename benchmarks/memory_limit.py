"""MemoryLimit: a limit of main memory for the processes that a benchmark starts.

The limit is one for all processes together where the system lets this program make a control group:
memory.limit_in_bytes of version 1, or memory.max of version 2. A process that needs more is killed.
Elsewhere it is RLIMIT_AS, the address space of each process, which counts what is only reserved
too: torch alone takes more than 1 GB of it. A process that asks for more is refused, and says so.
"""

from __future__ import annotations

import os
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from gsfw.core.control_groups import control_groups
from gsfw.core.machine_memory import LIMITS


@dataclass(frozen=True)
class MemoryLimit:
    """A limit that holds for a process from ``enter`` on."""

    name: str
    """Name of what enforces it."""
    enter: Callable[[], None]
    """Called in a new process before its program starts."""


@contextmanager
def memory_limit(megabytes: int, kind: str = "auto") -> Iterator[MemoryLimit]:
    """Make a limit; a control group is removed at the end.

    Args:
        megabytes: of 1e6 bytes.
        kind: "auto", or "address" for the address space of each process.
    """
    size = megabytes * 10**6
    made = _group(size) if kind == "auto" else None
    if made is None:
        limits = (size, size)
        enter = lambda: resource.setrlimit(resource.RLIMIT_AS, limits)  # noqa: E731
        yield MemoryLimit("RLIMIT_AS of each process", enter)
        return
    group, name = made
    processes = group / "cgroup.procs"
    try:
        yield MemoryLimit(name, lambda: _write(processes, os.getpid()))
    finally:
        group.rmdir()


def _group(size: int) -> tuple[Path, str] | None:
    """A new control group with a limit, and the limit's name; ``None`` where it cannot be made."""
    name = f"gsfw-benchmark-{os.getpid()}"
    for parent in control_groups("memory"):
        group, file = parent.folder / name, LIMITS[parent.version]
        try:
            group.mkdir()
        except OSError:
            continue
        if (group / file).exists():  # A plain folder limits nothing.
            try:
                _write(group / file, size)
                return group, f"{file} of a control group"
            except OSError:
                pass
        group.rmdir()
    return None


def _write(path: Path, number: int) -> None:
    path.write_text(str(number))
