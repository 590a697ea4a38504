"""Times of a training step with each of two installations of gsfw, in turns.

    python benchmarks/installations_in_turns.py WORKLOAD ROUNDS PYTHON PYTHON

WORKLOAD is an npz file, as in `gsfw bench`. Each PYTHON, an interpreter with gsfw installed, trains
in a process of its own with the CPU rasterizer and one thread. In each round both do a step that is
not measured, then two that are. Prints medians of CPU time in milliseconds of a step and its parts,
and the median over rounds of the second divided by the first, with quartiles.
"""

from __future__ import annotations

import json
import subprocess
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path
from statistics import fmean, median, quantiles

import torch

from gsfw.core.loop.determinism import deterministic
from gsfw.core.render_settings import RenderSettings, Validation
from gsfw.kernels.cpu.native_module import keep_freed_memory
from gsfw.kernels.cpu.operators import CpuOperators
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer
from gsfw.studies.bench.steps import TrainingStep
from gsfw.studies.bench.timing import Timings
from gsfw.studies.bench.workload import read_workload

MEASURED = 2
"""Measured steps of a round."""

PARTS = ("step", "activation", "render", "loss", "step_backward", "check", "optimizer")


def serve(workload: Path) -> None:
    """Answer each line of the standard input with the times of a round."""
    torch.set_num_threads(1)
    keep_freed_memory()
    rasterizer, settings = CpuRasterizer(), RenderSettings(validation=Validation.CHEAP)
    step = TrainingStep(read_workload(workload), CpuOperators())
    with deterministic(torch.device("cpu")):
        for _ in sys.stdin:
            step.run(rasterizer, settings)
            found = [times(step, rasterizer, settings) for _ in range(MEASURED)]
            answer = {part: fmean(t[part] for t in found) for part in found[0]}
            sys.stdout.write(json.dumps(answer) + "\n")
            sys.stdout.flush()


def times(
    step: TrainingStep, rasterizer: CpuRasterizer, settings: RenderSettings
) -> dict[str, float]:
    """CPU milliseconds of a step, its parts and the stages of rendering."""
    timings = Timings()
    step.measure(rasterizer, settings, timings)
    parts = {part: timings.latest(part).cpu_ms for part in PARTS}
    return parts | {stage: time.cpu_ms for stage, time in rasterizer.stage_times().items()}


def compare(workload: str, rounds: int, pythons: list[str]) -> None:
    """Print the medians and ratios."""
    processes = [
        subprocess.Popen(
            [python, __file__, workload], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for python in pythons
    ]
    found: list[list[dict[str, float]]] = [[] for _ in processes]
    for _ in range(rounds + 1):
        for process, rows in zip(processes, found, strict=True):
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.write("round\n")
            process.stdin.flush()
            rows.append(json.loads(process.stdout.readline()))
    for process in processes:
        process.communicate()
    first, second = (rows[1:] for rows in found)
    for part in first[0]:
        ratios = [b[part] / a[part] for a, b in zip(first, second, strict=True)]
        low, middle, high = quantiles(ratios, n=4)
        a, b = (median(row[part] for row in rows) for rows in (first, second))
        sys.stdout.write(f"{part:18} {a:7.2f} {b:7.2f}   {middle:.3f} ({low:.3f} to {high:.3f})\n")


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("workload")
    parser.add_argument("rounds", type=int, nargs="?", help="left out by the processes measured")
    parser.add_argument("pythons", nargs="*", metavar="python")
    given = parser.parse_args()
    if given.rounds is None:
        serve(Path(given.workload))
    else:
        compare(given.workload, given.rounds, given.pythons)
