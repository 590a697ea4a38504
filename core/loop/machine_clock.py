"""MachineClock: the time of a run since its start, and how busy the machine is with other work."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path

from gsfw.core.cores import cores

THREADS = Path("/proc/self/task")
"""Threads of this process on Linux. The second number of the file ``schedstat`` of each is the
nanoseconds in which it could have run and other work had its processor."""


@dataclass(frozen=True)
class Work:
    """Times of the threads of this process."""

    ran: float = 0.0
    """Seconds on a processor, over all threads, those that have ended among them."""
    waited: float = 0.0
    """Seconds in which a thread waited for a processor, over all threads that have not ended: for
    other processes, or for other threads of this one. Zero where the system does not tell."""
    had: float = 0.0
    """Seconds of the clock times the number of processors that this process may use."""

    def slowdown(self, before: Work) -> float:
        """Time of the work since ``before`` over that on an idle machine; 1 if it is not known.

        Processors that this process has no use for change nothing. Threads that wait for one
        another do not count: with all processors to itself, the process would have run for no more
        than these had.
        """
        ran, waited = self.ran - before.ran, self.waited - before.waited
        if ran <= 0:
            return 1.0
        return max(min((ran + waited) / ran, (self.had - before.had) / ran), 1.0)


class MachineClock:
    """Reads the clocks of the machine; tests have one of their own."""

    def __init__(self, began: float) -> None:
        """Count from a moment.

        Args:
            began: ``time.perf_counter()`` at the start of the command.
        """
        self._began = began + _now() - time.perf_counter()

    def seconds(self) -> float:
        """Wall-clock time since the start of the run."""
        return _now() - self._began

    def work(self) -> Work:
        """The work of this process so far; reads a file for each thread."""
        waited = math.fsum(map(_waited, _threads()))
        return Work(time.process_time(), waited, cores() * self.seconds())


def _threads() -> list[Path]:
    try:
        return list(THREADS.iterdir())
    except OSError:
        return []


def _waited(thread: Path) -> float:
    """Seconds in which a thread waited for a processor."""
    try:
        return int((thread / "schedstat").read_text().split()[1]) / 1e9
    except (OSError, ValueError, IndexError):  # It has ended, or this system has no such file.
        return 0.0


def _now() -> float:
    """Seconds that go on while the machine sleeps, where the system has such a clock."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if clock is None else time.clock_gettime(clock)
