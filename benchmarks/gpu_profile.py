"""Profile: counters of every kernel of ours, as NVIDIA's Nsight Compute reads them."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median

METRICS = {
    "gpu__time_duration.sum": "microseconds",
    "launch__registers_per_thread": "registers",
    "sm__warps_active.avg.per_cycle_active": "warps",
    "smsp__inst_executed.sum": "instructions",
    "sm__inst_executed.avg.pct_of_peak_sustained_elapsed": "issue",
    "gpu__compute_memory_throughput.avg.pct_of_peak_sustained_elapsed": "memory",
    "dram__bytes.sum": "bytes",
}
"""Counters, and the names of the fields that they fill."""

UNITS = {"ns": 1e-3, "us": 1.0, "usecond": 1.0, "ms": 1e3, "msecond": 1e3, "nsecond": 1e-3}
UNITS |= {"byte": 1.0, "Kbyte": 1e3, "Mbyte": 1e6, "Gbyte": 1e9}
"""Factors to microseconds and to bytes."""

LAUNCHES = 150
"""More than an image with its gradient and a step take. Each is repeated once per few counters."""


@dataclass(frozen=True)
class KernelProfile:
    """One kernel: medians over its launches."""

    name: str
    launches: int
    microseconds: float
    registers: float
    warps: float
    """Resident on a multiprocessor, on average while it works."""
    instructions: float
    issue: float
    """Percent of the instructions that it could issue."""
    memory: float
    """Percent of the bandwidth of the busiest memory."""
    bytes: float
    """Bytes of the GPU's memory that are read and written."""


def profiler(program: str) -> list[str]:
    """The command before the one that is profiled. Clocks are left as they are."""
    command = [program, "--clock-control", "none", "--csv", "--page", "raw"]
    command += ["--kernel-name-base", "mangled", "--kernel-name", "regex:gsfw"]
    command += ["--launch-count", str(LAUNCHES), "--kill", "yes"]
    return [*command, "--metrics", ",".join(METRICS)]


def read_profile(output: str) -> list[KernelProfile]:
    """Read the table that it prints, in the order of first launches."""
    lines = output.splitlines()
    start = next((i for i, line in enumerate(lines) if line.startswith('"ID"')), len(lines))
    rows = list(csv.DictReader(lines[start:]))
    if not rows:
        return []
    units, launches = rows[0], rows[1:]
    by_name: dict[str, list[dict[str, str]]] = {}
    for row in launches:
        by_name.setdefault(row["Kernel Name"], []).append(row)
    return [_profile(name, of_kernel, units) for name, of_kernel in by_name.items()]


def _profile(name: str, rows: list[dict[str, str]], units: dict[str, str]) -> KernelProfile:
    figures = {
        field: median(_numbers(rows, metric, UNITS.get(units.get(metric, ""), 1.0)))
        for metric, field in METRICS.items()
    }
    short = name.partition("(")[0].removeprefix("void ")
    return KernelProfile(short, len(rows), **figures)


def _numbers(rows: list[dict[str, str]], metric: str, factor: float) -> Iterator[float]:
    for row in rows:
        text = (row.get(metric) or "").replace(",", "")
        yield float(text) * factor if text else 0.0
