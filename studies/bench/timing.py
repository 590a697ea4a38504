"""Timing: readings of two clocks, by name, and their medians."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from statistics import median

import torch

from gsfw.core.loop.device import wait_for
from gsfw.core.rasterizer import StageTime
from gsfw.studies.bench import device as bench_device


class Timings:
    """What stages took, one reading per repeat: CPU time of the whole process, and wall time."""

    def __init__(self) -> None:
        self._readings: dict[str, list[StageTime]] = {}

    def add(self, name: str, reading: StageTime) -> None:
        """Keep a reading."""
        self._readings.setdefault(name, []).append(reading)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure what happens inside."""
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

        Medians and least values; those with ``wall`` are wall time, the others CPU time, or time
        of the GPU. NAME_spread_ms is the distance of the quartiles, of wall time.
        """
        figures: dict[str, float] = {}
        for name, readings in self._readings.items():
            cpu = [reading.cpu_ms for reading in readings]
            wall = [reading.wall_ms for reading in readings]
            figures[f"{name}_ms"], figures[f"{name}_wall_ms"] = median(cpu), median(wall)
            figures[f"{name}_min_ms"], figures[f"{name}_min_wall_ms"] = min(cpu), min(wall)
            figures[f"{name}_spread_ms"] = _spread(wall)
        return figures


class GpuTimings(Timings):
    """The same on a GPU: time between marks in what it has to do, and wall time.

    The host waits for the GPU before the outermost stage begins and where it ends, and nowhere
    within: stages inside it overlap as they do in training, and their wall time is that of the GPU.
    """

    def __init__(self, device: torch.device) -> None:
        super().__init__()
        self._device = device
        self._depth = 0
        self._passed: list[tuple[str, torch.cuda.Event, torch.cuda.Event]] = []

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure what happens inside."""
        outermost = self._depth == 0
        if outermost:
            wait_for(self._device)
        wall, begin = time.perf_counter_ns(), bench_device.mark(self._device)
        self._depth += 1
        try:
            yield
        finally:
            self._depth -= 1
        end = bench_device.mark(self._device)
        if not outermost:
            self._passed.append((name, begin, end))
            return
        wait_for(self._device)
        wall = time.perf_counter_ns() - wall
        self.add(name, StageTime(bench_device.milliseconds(begin, end), wall / 1e6))
        for inner, *marks in self._passed:
            took = bench_device.milliseconds(*marks)
            self.add(inner, StageTime(took, took))
        self._passed.clear()


def timings_on(device: torch.device) -> Timings:
    """The clocks for what runs on ``device``."""
    return GpuTimings(device) if device.type == "cuda" else Timings()


def total(readings: list[StageTime]) -> StageTime:
    """The sum of several stages."""
    return StageTime(
        sum(reading.cpu_ms for reading in readings), sum(reading.wall_ms for reading in readings)
    )


def _spread(values: list[float]) -> float:
    """Between the quartiles."""
    ordered = sorted(values)
    last = len(ordered) - 1
    return ordered[round(0.75 * last)] - ordered[round(0.25 * last)]
