"""MachineClock: the time of a run since its start, and how busy the machine is with other work."""

from __future__ import annotations

import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Reading:
    """A moment of a run."""

    seconds: float
    """Wall-clock time since the start of the run."""
    own_seconds: float
    """Processor time of this process, over all its threads."""


class MachineClock:
    """Reads the clocks of the machine; tests have one of their own."""

    def __init__(self, began: float) -> None:
        """Count from a moment.

        Args:
            began: ``time.perf_counter()`` at the start of the command.
        """
        self._began = began + _now() - time.perf_counter()

    def read(self) -> Reading:
        """The time now."""
        return Reading(_now() - self._began, time.process_time())


def _now() -> float:
    """Seconds that go on while the machine sleeps, where the system has such a clock."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if clock is None else time.clock_gettime(clock)
