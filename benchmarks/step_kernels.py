"""Times a training step on a GPU: one by one, as a CUDA graph, and the sum of its kernels.

    PYTHONPATH=... python benchmarks/step_kernels.py WORKLOAD [--chunk 128,64] [--gsplat]

WORKLOAD is an npz file or random:COUNT, as in `gsfw bench`. ``--chunk`` sets splats per chunk and
threads per chunk of the RGB kernels (``CHUNKS`` in kernels/cuda/instances.py) for this process;
``--gsplat`` measures the step of gsplat's own trainer instead.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import torch
from printing import say
from torch.profiler import ProfilerActivity, profile

from gsfw.core.errors import UserError
from gsfw.core.loop.recording import CudaRecorder
from gsfw.kernels.cuda.instances import CHUNKS
from gsfw.plugins.loading import choose_operators
from gsfw.plugins.registry import installed
from gsfw.rasterizers.gsplat import package
from gsfw.studies.bench.steps import GsplatStep, TrainingStep
from gsfw.studies.bench.timing import warm_up
from gsfw.studies.bench.workload import RANDOM, Workload, random_workload, read_workload
from gsfw.studies.entrants import entrant_of

ROUNDS, STEPS = 5, 20
"""Measurements, of which the median counts, and steps of each."""

LINES = 24
"""Kernels that are printed, the longest first."""

Step = Callable[[], None]


def main() -> int:
    """Measure, and print the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("workload", help="an npz file, or random:COUNT")
    parser.add_argument("--chunk", type=_pair, help="splats and threads, as in 128,64")
    parser.add_argument("--gsplat", action="store_true", help="the step of gsplat's own trainer")
    options = parser.parse_args()
    if not torch.cuda.is_available():
        say("there is no GPU to use: torch sees none")
        return 3
    if options.chunk:
        CHUNKS[torch.float32][4] = options.chunk
    device = torch.device("cuda", 0)
    try:
        workload = _workload(options.workload, device)
    except UserError as error:
        say(str(error))
        return 2
    recorder = CudaRecorder(device)
    with recorder.working():
        warm_up(device)
        step = _step(workload, device, options.gsplat)
        say(f"one by one: {pace(step):.3f} ms a step")
        kernels(step)
        if not options.gsplat:
            say(f"as a CUDA graph: {pace(recorder.record(step).replay):.3f} ms a step")
    return 0


def _pair(text: str) -> tuple[int, int]:
    splats, threads = map(int, text.split(","))
    return splats, threads


def _workload(given: str, device: torch.device) -> Workload:
    """Read or make a workload.

    Raises:
        UserError: it is no workload; says why.
    """
    if given.startswith(RANDOM):
        return random_workload(given, device)
    return read_workload(Path(given)).to(device)


def _step(workload: Workload, device: torch.device, gsplat: bool) -> Step:
    registry = installed()
    operators = choose_operators(registry, device)
    if gsplat:
        return GsplatStep(package.load(), workload, operators).run
    entrant = entrant_of("cuda", registry, device)
    step = TrainingStep(workload, operators)
    return lambda: step.run(entrant.rasterizer, entrant.settings)


def pace(step: Step) -> float:
    """Milliseconds per step of steps in a row, which the host does not wait for one by one."""
    found = []
    for _ in range(ROUNDS + 1):  # The first one warms up.
        torch.cuda.synchronize()
        began = time.perf_counter()
        for _ in range(STEPS):
            step()
        torch.cuda.synchronize()
        found.append(1e3 * (time.perf_counter() - began) / STEPS)
    return median(found[1:])


def kernels(step: Step) -> None:
    """Print the time of each kernel in a step, and their sum."""
    with profile(activities=[ProfilerActivity.CUDA]) as profiler:
        for _ in range(STEPS):
            step()
        torch.cuda.synchronize()
    rows = [
        (event.self_device_time_total / STEPS, event.count / STEPS, event.key)
        for event in profiler.key_averages()
        # Names with # are ranges of time around kernels.
        if event.self_device_time_total > 0 and "#" not in event.key
    ]
    rows.sort(reverse=True)
    total, launches = sum(row[0] for row in rows), sum(row[1] for row in rows)
    say(f"kernels: {total / 1e3:.3f} ms a step, {launches:.0f} launches")
    for microseconds, count, name in rows[:LINES]:
        say(f"  {microseconds:9.1f} us {count:5.1f}x {name[:100]}")


if __name__ == "__main__":
    sys.exit(main())
