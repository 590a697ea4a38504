"""Timing: readings of two clocks by name, their medians, and the memory and clocks of a GPU."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from statistics import median

import torch

from gsfw.core.loop.device import wait_for
from gsfw.core.rasterizer import StageTime

WARM_UP_SECONDS = 1.0
WARM_UP_SIDE = 4096
"""Side of the matrices whose product brings a GPU to its clocks under load."""


class Timings:
    """Times of stages, one reading per repeat: CPU time of the whole process, and wall time."""

    def __init__(self) -> None:
        self._readings: dict[str, list[StageTime]] = {}

    def add(self, name: str, reading: StageTime) -> None:
        """Keep a reading."""
        self._readings.setdefault(name, []).append(reading)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the time of the block."""
        # The clocks are read in the same order twice, so both see one reading of the other.
        cpu, wall = time.process_time_ns(), time.perf_counter_ns()
        yield
        cpu, wall = time.process_time_ns() - cpu, time.perf_counter_ns() - wall
        self.add(name, StageTime(cpu / 1e6, wall / 1e6))

    def latest(self, name: str) -> StageTime:
        """The last reading of a stage."""
        return self._readings[name][-1]

    def figures(self) -> Mapping[str, float]:
        """NAME_ms, NAME_wall_ms, NAME_min_ms, NAME_min_wall_ms and NAME_spread_ms of every stage.

        The first two are medians, ``min`` is the least value, and ``spread`` is the distance of the
        quartiles of wall time. Figures without ``wall`` are CPU time, or time of the GPU.
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
    """Times of stages on a GPU: time between marks in its stream, and wall time.

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
        """Measure the time of the block."""
        outermost = self._depth == 0
        if outermost:
            wait_for(self._device)
        wall, begin = time.perf_counter_ns(), mark(self._device)
        self._depth += 1
        try:
            yield
        finally:
            self._depth -= 1
        end = mark(self._device)
        if not outermost:
            self._passed.append((name, begin, end))
            return
        wait_for(self._device)
        wall = time.perf_counter_ns() - wall
        self.add(name, StageTime(milliseconds(begin, end), wall / 1e6))
        for inner, *marks in self._passed:
            took = milliseconds(*marks)
            self.add(inner, StageTime(took, took))
        self._passed.clear()


def timings_on(device: torch.device) -> Timings:
    """The clocks of a device."""
    return GpuTimings(device) if device.type == "cuda" else Timings()


def mark(device: torch.device) -> torch.cuda.Event:
    """Record an event in the current stream of the GPU."""
    event = torch.cuda.Event(enable_timing=True)
    event.record(torch.cuda.current_stream(device))
    return event


def milliseconds(begin: torch.cuda.Event, end: torch.cuda.Event) -> float:
    """Time between two events on the GPU's clock; both must have completed."""
    return begin.elapsed_time(end)


def begin_peak(device: torch.device) -> float:
    """Reset the peak of memory; megabytes that are allocated now, and 0 on the CPU."""
    if device.type != "cuda":
        return 0.0
    torch.cuda.reset_peak_memory_stats(device)
    return torch.cuda.memory_allocated(device) / 1e6


def peak_mb(device: torch.device) -> float:
    """Peak of allocated memory since ``begin_peak`` in megabytes, and 0 on the CPU."""
    return torch.cuda.max_memory_allocated(device) / 1e6 if device.type == "cuda" else 0.0


def warm_up(device: torch.device) -> None:
    """Keep a GPU busy for a second: an idle one runs at a fraction of its clock."""
    if device.type != "cuda":
        return
    matrix = torch.ones(WARM_UP_SIDE, WARM_UP_SIDE, device=device)
    end = time.perf_counter() + WARM_UP_SECONDS
    while time.perf_counter() < end:
        torch.mm(matrix, matrix)
        wait_for(device)


def total(readings: list[StageTime]) -> StageTime:
    """The sum of several stages."""
    return StageTime(
        sum(reading.cpu_ms for reading in readings), sum(reading.wall_ms for reading in readings)
    )


def _spread(values: list[float]) -> float:
    """Distance of the quartiles."""
    ordered = sorted(values)
    last = len(ordered) - 1
    return ordered[round(0.75 * last)] - ordered[round(0.25 * last)]
