"""Ways: how one scene can be trained, each with memory, bytes and hours by the formulas.

Machines, network, failures and visits are assumptions, the constants here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scaling_faults as faults
import scaling_formulas as formulas
from scaling_formulas import Costs, Machine, View

from gsfw.core.training_memory import POINT_BYTES
from gsfw.partition.plan import MOST_BLOCKS

GIGABIT = 1e9 / 8
NETWORKS = {"10 Gbit/s": 10 * GIGABIT, "100 Gbit/s": 100 * GIGABIT}
"""Assumed networks; it is assumed too that processors keep up with them."""
MACHINE = Machine(cores=64, memory_mb=256_000, network=NETWORKS["100 Gbit/s"])
"""Assumed machine; its cores are as fast as the measured one, and scale without loss."""
VIEW = View(width=1280, height=800)
SCENES = ((1e4, 1e6), (1e4, 1e7), (1e5, 1e8), (1e6, 1e9), (1e7, 1e10))
"""Images and Gaussians of the plan."""
POINTS_PER_IMAGE = 500
"""Points of the reconstruction: an assumption."""
VISITS = 30
"""Times that training sees each photo: an assumption, to which hours are proportional."""
IMAGE_BYTES = 0.18
"""Bytes of a pixel of a photo; the JPEGs of fox and plush have 0.18."""
FAILURE = 10_000 * 3600.0
"""Mean seconds between failures of one machine: an assumption."""
RESTART, DISK = 300.0, 1e9
"""Seconds to start again, and bytes per second to write a checkpoint: assumptions."""
SMALL_BLOCK = 4e6
"""Rows of a small block, some ten times as many as a view sees: views of far smaller ones would
belong to more blocks than the margin says."""
MERGING_BYTES = 2 * formulas.ROW_NUMBERS * formulas.FLOAT
"""Bytes of a Gaussian while blocks are merged, at least: those of the blocks, and the whole."""


Way = Literal["one process", "data parallel", "Gaussian parallel"]


def _alone(costs: Costs, machine: Machine, view: View, rows: float, size: int, views: int) -> float:
    return formulas.one_process_seconds(costs, machine, view, rows, views)


WAYS: Mapping[Way, Callable[[Costs, Machine, View, float, int, int], float]] = {
    "one process": _alone,
    "data parallel": formulas.data_parallel_seconds,
    "Gaussian parallel": formulas.gaussian_parallel_seconds,
}
"""Seconds of a step: of costs, machine, view, rows, processes and views."""


@dataclass(frozen=True)
class Plan:
    """One way of training one scene."""

    mode: str
    images: float
    rows: float
    machines: int
    memory_mb: float
    """Memory of a process."""
    sent: float
    """Bytes that a process sends in a step."""
    seconds: dict[str, float]
    """Time of a step, by network; all processes wait for the slowest."""
    hours: float
    """Time of the whole training, with failures, at the fastest network."""
    streamed: float
    """Bytes of photos that one machine reads in a second."""
    remark: str = ""

    @property
    def works(self) -> bool:
        """False where it does not fit."""
        return not self.remark.startswith("no:")

    def line(self) -> str:
        """A row of a table of Markdown."""
        cells = [self.mode, f"{self.machines}", readable(1e6 * self.memory_mb)]
        if self.works:
            cells += [readable(self.sent), *(f"{value:.3g}" for value in self.seconds.values())]
            cells += [f"{self.hours:,.3g}" if self.hours < 1000 else f"{self.hours:,.0f}"]
            cells += [readable(self.streamed)]
        else:
            cells += [""] * (3 + len(self.seconds))
        return "| " + " | ".join([*cells, self.remark]) + " |"


@dataclass(frozen=True)
class Planner:
    """Makes plans with measured costs."""

    costs: Costs
    steps: Sequence[float]
    """Measured times of steps of one process, for stragglers."""

    def plans(self, images: float, rows: float) -> Iterator[Plan]:
        """All ways of training a scene."""
        size = 128 if rows > 1e9 else 16
        points = POINTS_PER_IMAGE * images
        yield self._together("one process", images, rows, 1)
        yield self._together("data parallel", images, rows, size)
        yield self._together("Gaussian parallel", images, rows, size)
        fewest = formulas.blocks_for(rows, MACHINE.memory_mb, points)
        most = max(math.ceil(rows * formulas.block_overlap() / SMALL_BLOCK), 1)
        if fewest is None:
            return
        if fewest > 1:
            yield self._blocks("blocks, as large as fit", images, rows, size, fewest)
        if most > fewest:
            yield self._blocks("small blocks", images, rows, size, most)
        teams = formulas.blocks_for(rows, MACHINE.memory_mb, points, 8)
        if teams is not None and fewest > 1:
            yield self._blocks("blocks of 8 machines", images, rows, size, teams, 8)

    def _seconds(self, way: Way, rows: float, size: int) -> dict[str, float]:
        """Seconds of a step of as many views as processes, by network."""
        found = {"measured": self._step(way, rows, size, self.costs, math.inf)}
        keeps_up = replace(self.costs, bytes_per_second=math.inf)
        for name, speed in NETWORKS.items():
            found[name] = self._step(way, rows, size, keeps_up, speed)
        return {name: each * self.waiting(size) for name, each in found.items()}

    def _step(self, way: Way, rows: float, size: int, costs: Costs, speed: float) -> float:
        machine = replace(MACHINE, network=speed)
        return WAYS[way](costs, machine, VIEW, rows, size, size)

    def _remark(self, way: Way, rows: float, size: int) -> str:
        """The network at which processes exchange for longer than they compute."""
        silent = replace(self.costs, bytes_per_second=math.inf, latency=0.0)
        computing = self._step(way, rows, size, silent, math.inf)
        for name, seconds in reversed(self._seconds(way, rows, size).items()):
            if name in NETWORKS and seconds / self.waiting(size) > 2 * computing:
                return f"exchange takes longest at {name}"
        return ""

    def waiting(self, size: int) -> float:
        """Factor of a step's time by which the slowest of so many processes holds up the others."""
        return faults.straggling(self.steps, size, np.random.default_rng(0)) if size > 1 else 1.0

    def _together(self, mode: Way, images: float, rows: float, size: int) -> Plan:
        """A scene in one piece: every step has as many views as processes."""
        points = POINTS_PER_IMAGE * images
        is_divided = mode == "Gaussian parallel"
        sent, own = 0.0, rows
        memory = formulas.memory_bytes(rows, points)
        if mode == "data parallel":
            parameters = rows * formulas.ROW_NUMBERS
            sent = formulas.data_parallel_bytes(
                parameters, size, size, rows, formulas.MEASURED_ROWS
            )
        elif is_divided:
            memory = formulas.gaussian_parallel_memory(rows, size, VIEW, points, points)
            sent, own = formulas.gaussian_parallel_bytes(rows, size, VIEW, size), rows / size
        seconds = self._seconds(mode, rows, size)
        work = VISITS * images / size * seconds["100 Gbit/s"]
        hours = with_failures(work, own if is_divided else rows, size) / 3600
        image_rate = (size if is_divided else 1) / seconds["100 Gbit/s"]
        remark = self._remark(mode, rows, size) if size > 1 else ""
        if memory > MACHINE.memory_mb * 1e6:
            remark = "no: does not fit"
        return Plan(
            mode, images, rows, size, memory / 1e6, sent, seconds, hours,
            image_rate * IMAGE_BYTES * VIEW.pixels, remark,
        )  # fmt: skip

    def _blocks(
        self, mode: str, images: float, rows: float, machines: int, blocks: int, team: int = 1
    ) -> Plan:
        """Blocks that are trained independently, each by one machine or by a team."""
        points, own = POINTS_PER_IMAGE * images, formulas.block_rows(rows, blocks)
        overlap = formulas.block_overlap() if blocks > 1 else 1.0
        kind: Way = "Gaussian parallel" if team > 1 else "one process"
        seconds = self._seconds(kind, own, team)
        steps = VISITS * images * overlap / blocks / team
        each = with_failures(steps * seconds["100 Gbit/s"], own / team, team)
        hours = each * math.ceil(blocks / (machines // team)) / 3600
        remarks = [f"{blocks} blocks"]
        if blocks > MOST_BLOCKS:
            remarks.append(f"`blocks=auto` ends at {MOST_BLOCKS}")
        if blocks > 1 and rows * MERGING_BYTES > MACHINE.memory_mb * 1e6:
            remarks.append("merging does not fit")
        if points * POINT_BYTES > MACHINE.memory_mb * 1e6 / 2:
            remarks.append(f"{readable(points * POINT_BYTES)} of each are points")
        memory = formulas.memory_bytes(own, points)
        if team > 1:
            start = formulas.block_rows(points, blocks)
            memory = formulas.gaussian_parallel_memory(own, team, VIEW, points, start)
        sent = formulas.gaussian_parallel_bytes(own, team, VIEW, team) if team > 1 else 0.0
        return Plan(
            mode, images, rows, machines, memory / 1e6, sent, seconds, hours,
            team / seconds["100 Gbit/s"] * IMAGE_BYTES * VIEW.pixels, "; ".join(remarks),
        )  # fmt: skip


def with_failures(work: float, rows: float, machines: int) -> float:
    """Seconds of a job with failures, checkpoints at Daly's interval.

    Args:
        work: seconds without any.
        rows: Gaussians that one machine writes to a checkpoint.
        machines: any of them ends the job when it fails.
    """
    checkpoint = formulas.checkpoint_bytes(rows) / DISK
    between = FAILURE / machines
    interval = min(faults.daly_interval(checkpoint, between), work)
    return faults.time_with_failures(work, interval, checkpoint, RESTART, between)


def readable(count: float) -> str:
    """Bytes for people."""
    for unit, factor in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if count >= factor:
            return f"{count / factor:.3g} {unit}"
    return f"{count:.0f} B" if count < 1e3 else f"{count / 1e3:.3g} kB"
