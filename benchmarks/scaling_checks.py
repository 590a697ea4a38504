"""Checks: each formula beside a measurement of a small case on this machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np
import scaling_faults as faults
import scaling_formulas as formulas
import torch
from scaling_costs import CPU, LARGE, SETTINGS, Case, case, step_times
from scaling_formulas import Costs, Machine

from gsfw.rasterizers.reference.project import project, visible_extents

STEPS, POINTS, MORE = 44, 50_000, 250_000
WARM_UP = 4
"""First steps that are left out: they are slower."""
TRAINING = (
    *("train", "method=3dgs", "datamanager=synthetic", "strategy=none", "report=false"),
    *("log_every=1", "datamanager.views=24", "datamanager.width=160", "datamanager.height=120"),
)
"""A small run without growth, whose number of rows is known."""


@dataclass(frozen=True)
class Check:
    """A formula and a measurement of one quantity."""

    name: str
    formula: float
    measured: float
    unit: str

    def line(self) -> str:
        """A row of a table of Markdown."""
        ratio = self.formula / self.measured
        return f"| {self.name} | {self.formula:.4g} | {self.measured:.4g} {self.unit} | {ratio:.2f}"


@dataclass(frozen=True)
class Trained:
    """A small run of ``gsfw train``."""

    document: Mapping[str, float]
    steps: Sequence[float]
    """Wall seconds of its steps after the first ones."""


def trained(points: int, processes: int = 0) -> Trained:
    """Train a small run in a process of its own, with one thread for each process."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        words = [*TRAINING, f"steps={STEPS}", f"datamanager.points={points}", f"out={out}"]
        words += [f"processes={processes}"] if processes else []
        environment = os.environ | {"OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "gsfw", *words]
        subprocess.run(command, env=environment, capture_output=True, check=True)
        document = json.loads((out / "metrics.json").read_text())
        lines = (out / "metrics.jsonl").read_text().splitlines()
    found = [json.loads(line) for line in lines]
    times = [line["step_ms"] / 1e3 for line in found if "step_ms" in line]
    return Trained(document, times[WARM_UP:])


def counted_copies(scene: Case, size: int) -> float:
    """Bands that each visible splat of a scene really touches, in the mean."""
    ellipses = project(scene.splats, scene.camera, SETTINGS)
    visible, extents = visible_extents(ellipses, scene.camera, SETTINGS)
    middle, half = ellipses.means[visible, 1], extents[visible, 1]
    height = scene.camera.height
    borders = torch.linspace(0, height, size + 1, device=CPU)
    first = (middle - half).clamp(0, height - 1e-3)
    last = (middle + half).clamp(0, height - 1e-3)
    bands = torch.bucketize(last, borders[1:-1]) - torch.bucketize(first, borders[1:-1]) + 1
    return float(bands.float().mean())


def computing_checks(costs: Costs) -> Iterator[Check]:
    """Steps of one process, of other sizes than those that the costs come from."""
    still = replace(costs, decode=0.0)
    alone = Machine(cores=1, memory_mb=8000, network=float("inf"))
    for scene in (case(60_000, 480, 315), case(40_000, 640, 420).hiding(60_000)):
        seen = scene.view
        name = (
            f"step of one process: {scene.rows} Gaussians, {seen.seen} in view, "
            f"{seen.width} x {seen.height}"
        )
        expected = formulas.one_process_seconds(still, alone, seen, scene.rows)
        yield Check(name, expected, step_times(scene, 5)["step"], "s (CPU)")


def exchange_checks(costs: Costs, times: Mapping[int, float]) -> Iterator[Check]:
    """The network, and the bands that splats touch."""
    machine = Machine(1, 8000, float("inf"))
    sent = LARGE // 4
    expected = formulas.exchange_seconds(costs, machine, sent, 1, 2)
    yield Check(f"all-to-all of two processes, {sent} bytes sent", expected, times[sent], "s")
    scene = case(60_000, 480, 315)
    for size in (2, 8, 32):
        name = f"bands of {size} that a splat touches (mean height {scene.view.splat_height:.1f})"
        found = counted_copies(scene, size)
        yield Check(name, formulas.band_copies(scene.view, size), found, "bands")


def training_checks(costs: Costs, runs: tuple[Trained, Trained, Trained]) -> Iterator[Check]:
    """Memory, bytes and time of whole runs.

    Args:
        costs: of this machine.
        runs: one process with ``POINTS`` Gaussians, one with ``MORE``, and two with ``POINTS``.
    """
    one, more, two = runs
    images = 32 * 160 * 120 * 3
    for run, rows, name in ((one, POINTS, ""), (more, MORE, ""), (two, POINTS, " of 2")):
        expected = (formulas.memory_bytes(rows, rows) + images) / 1e6
        peak = run.document["peak_memory_mb"]
        yield Check(f"peak memory of a process{name}, {rows} Gaussians", expected, peak, "MB")
    saved = one.document["model_bytes"] + one.document["optimizer_bytes"]
    yield Check("checkpoint", formulas.checkpoint_bytes(POINTS) / 1e6, saved / 1e6, "MB")
    parameters = POINTS * formulas.ROW_NUMBERS
    sent = formulas.data_parallel_bytes(parameters, 2, 2, POINTS, 2)
    found = two.document["bytes_sent"] / STEPS
    yield Check("data parallel: bytes of a step and process, 2 views", sent, found, "bytes")
    exchanged = formulas.exchange_seconds(costs, Machine(1, 8000, float("inf")), sent, 5, 2)
    name = "data parallel: step of two processes (step of one, plus the exchange)"
    yield Check(name, median(one.steps) + exchanged, median(two.steps), "s (wall)")


def fault_checks() -> Iterator[Check]:
    """The expected time with failures, against simulated jobs."""
    hour = 3600.0
    work, checkpoint, restart, between = 200 * hour, 120.0, 300.0, 10 * hour
    interval = faults.daly_interval(checkpoint, between)
    generator = np.random.default_rng(0)
    jobs = [
        faults.simulated_time(work, interval, checkpoint, restart, between, generator)
        for _ in range(300)
    ]
    expected = faults.time_with_failures(work, interval, checkpoint, restart, between) / hour
    name = "200 hours of work, a failure each 10 hours: Daly, and 300 simulated jobs"
    yield Check(name, expected, float(np.mean(jobs)) / hour, "hours")
