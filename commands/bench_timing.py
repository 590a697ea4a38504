"""Timing: readings of two clocks, by name, and their medians."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from statistics import median

from gsfw.core.rasterizer import StageTime


class Timings:
    """What stages took, one reading per repeat."""

    def __init__(self) -> None:
        self._readings: dict[str, list[StageTime]] = {}

    def add(self, name: str, reading: StageTime) -> None:
        """Keep a reading."""
        self._readings.setdefault(name, []).append(reading)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure what happens inside: CPU time of the whole process, and wall time."""
        # The clocks are read in the same order twice, so both see one reading of the other.
        cpu, wall = time.process_time_ns(), time.perf_counter_ns()
        yield
        cpu, wall = time.process_time_ns() - cpu, time.perf_counter_ns() - wall
        self.add(name, StageTime(cpu / 1e6, wall / 1e6))

    def latest(self, name: str) -> StageTime:
        """The last reading of a stage."""
        return self._readings[name][-1]

    def figures(self) -> Mapping[str, float]:
        """Of every stage: NAME_ms, NAME_wall_ms, NAME_min_ms and NAME_min_wall_ms.

        Medians and least values; those with ``wall`` are wall time, the others CPU time.
        """
        figures: dict[str, float] = {}
        for name, readings in self._readings.items():
            cpu = [reading.cpu_ms for reading in readings]
            wall = [reading.wall_ms for reading in readings]
            figures[f"{name}_ms"], figures[f"{name}_wall_ms"] = median(cpu), median(wall)
            figures[f"{name}_min_ms"], figures[f"{name}_min_wall_ms"] = min(cpu), min(wall)
        return figures


def total(readings: list[StageTime]) -> StageTime:
    """The sum of several stages."""
    return StageTime(
        sum(reading.cpu_ms for reading in readings), sum(reading.wall_ms for reading in readings)
    )
