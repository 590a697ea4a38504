"""Processes: memory, exchanged bytes and time of a step, by number of processes and way to divide.

    python benchmarks/processes.py                      # memory and bytes, then times
    python benchmarks/processes.py --only memory --points 50000 250000

Every run is ``gsfw train`` on the built-in scene without growth, with the same number of threads in
all. Memory is the largest private memory of any of its processes (Linux counts it), as the slope
between two numbers of Gaussians, so that the program itself and its images do not count. Times are
medians of steps of runs in turns, as ratios to one process.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from printing import say

from gsfw.core.machine_memory import anonymous_memory

SCENE = (
    *("train", "method=3dgs", "datamanager=synthetic", "strategy=none", "report=false"),
    *("log_every=1", "datamanager.views=16", "datamanager.eval_views=2", "eval_every=0"),
    *("cache_mb=64", "sampler.views_per_step=4", "optim.batch_scale=1"),
)
WARM_UP = 3
"""First steps that are left out: they are slower."""
POLL_SECONDS = 0.05


@dataclass(frozen=True)
class Way:
    """A way to train with several processes."""

    name: str
    processes: int
    words: tuple[str, ...] = ()

    @property
    def threads(self) -> int:
        """Threads of each process: those of all are as many for every way."""
        return max((os.cpu_count() or 1) // max(self.processes, 1), 1)


@dataclass(frozen=True)
class Trained:
    """A run that has ended."""

    memory_mb: float
    """Largest private memory of any of its processes."""
    bytes_sent: float
    """Bytes that the first process has sent in a step."""
    steps_ms: Sequence[float]
    """Wall-clock time of its steps after the first ones."""


def ways(most: int) -> list[Way]:
    """One process, and both ways with up to ``most``."""
    found = [Way("one process", 1)]
    sizes = [size for size in (2, 4, 8) if size <= most]
    found += [Way(f"views, {size} processes", size) for size in sizes]
    return found + [
        Way(f"Gaussians, {size} processes", size, (f"shards={most}",)) for size in (1, *sizes)
    ]


def train(way: Way, points: int, steps: int, size: tuple[int, int]) -> Trained:
    """Train a run, and watch the memory of its processes."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        words = [*SCENE, *way.words, f"steps={steps}", f"datamanager.points={points}"]
        words += [f"datamanager.width={size[0]}", f"datamanager.height={size[1]}"]
        words += [f"processes={way.processes}", f"out={out}"]
        process = subprocess.Popen(
            [sys.executable, "-m", "gsfw", *words],
            env=os.environ | {"OMP_NUM_THREADS": str(way.threads)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        most: dict[int, float] = {}
        while process.poll() is None:
            for pid, memory in memories(str(out)).items():
                most[pid] = max(most.get(pid, 0.0), memory)
            time.sleep(POLL_SECONDS)
        if process.returncode:
            assert process.stderr is not None
            sys.exit(process.stderr.read().decode())
        document = json.loads((out / "metrics.json").read_text())
        lines = [json.loads(line) for line in (out / "metrics.jsonl").read_text().splitlines()]
    times = [line["step_ms"] for line in lines if "step_ms" in line]
    sent = document.get("bytes_sent", 0) / steps
    return Trained(max(most.values(), default=0.0), sent, times[WARM_UP:])


def memories(word: str) -> Mapping[int, float]:
    """Private memory in MB of the processes whose command line has a word; Linux's alone."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if word.encode() not in (folder / "cmdline").read_bytes():
                continue
            found[int(folder.name)] = anonymous_memory(folder / "status") / 1e6
        except OSError:  # It has ended meanwhile.
            continue
    return found


def show_memory(numbers: Sequence[int], most: int, size: tuple[int, int]) -> None:
    """Print the bytes of each Gaussian in the largest process, and those that it sends."""
    few, many = numbers
    say(f"\n| {few} and {many} Gaussians | bytes each, largest process | of one process | sent |")
    say("| --- | --- | --- | --- |")
    whole = 0.0
    for way in ways(most):
        first, second = (train(way, points, 6, size) for points in (few, many))
        slope = (second.memory_mb - first.memory_mb) * 1e6 / (many - few)
        whole = whole or slope
        sent = second.bytes_sent / 1e6
        say(f"| {way.name} | {slope:.0f} | {slope / whole:.2f} | {sent:.2f} MB |")


def show_times(points: int, repeats: int, size: tuple[int, int]) -> None:
    """Print the time of a step against one process, of runs in turns."""
    found: dict[str, list[float]] = {}
    chosen = [
        way for way in ways(2) if way.threads * max(way.processes, 1) <= (os.cpu_count() or 1)
    ]
    for _ in range(repeats):
        for way in chosen:
            found.setdefault(way.name, []).append(median(train(way, points, 24, size).steps_ms))
    say(f"\n| {points} Gaussians, {size[0]}x{size[1]} | ms of a step | of one process |")
    say("| --- | --- | --- |")
    first = found[chosen[0].name]
    for name, times in found.items():
        ratio = median(own / one for own, one in zip(times, first, strict=True))
        say(f"| {name} | {median(times):.1f} | {ratio:.2f} |")


def main() -> None:
    """Measure on this machine."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=("memory", "time"))
    parser.add_argument("--points", type=int, nargs=2, default=(50_000, 250_000))
    parser.add_argument("--processes", type=int, default=4)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--size", type=int, nargs=2, default=(320, 240))
    given = parser.parse_args()
    size = (given.size[0], given.size[1])
    if given.only != "time":
        show_memory(given.points, given.processes, size)
    if given.only != "memory":
        show_times(given.points[0], given.repeats, size)


if __name__ == "__main__":
    main()
