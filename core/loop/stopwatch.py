"""Stopwatch: wall-clock time by stage of a step."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Adds up wall-clock time by stage, between two readings."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}
        self._steps = 0
        self._since = time.perf_counter()

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the work inside; on a GPU this is the time to launch it."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self._seconds[name] = self._seconds.get(name, 0.0) + time.perf_counter() - started

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Leave out the time inside, which is no part of a step."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self._since += time.perf_counter() - started

    def step_done(self) -> None:
        """Count one step."""
        self._steps += 1

    def read(self) -> tuple[float, dict[str, float]]:
        """Mean milliseconds per step since the last reading: total, and by stage."""
        now = time.perf_counter()
        steps = max(self._steps, 1)
        stages = {name: 1e3 * seconds / steps for name, seconds in self._seconds.items()}
        total = 1e3 * (now - self._since) / steps
        self.restart()
        return total, stages

    def restart(self) -> None:
        """Reset all sums, for instance after an evaluation, which is no part of a step."""
        self._seconds, self._steps, self._since = {}, 0, time.perf_counter()
