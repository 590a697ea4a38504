"""Costs: the constants of the formulas, measured on this machine on small cases.

Computing is measured as CPU time of one thread, which other programs disturb least; the network as
wall time between two processes of this machine (gloo). Everything takes about a minute.
"""

from __future__ import annotations

import io
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from statistics import median

import numpy as np
import torch
import torch.distributed as dist
import torch.multiprocessing as mp
from PIL import Image
from scaling_formulas import Costs, View
from torch.distributed import TCPStore  # type: ignore[attr-defined]

from gsfw.core.cameras import Cameras
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.kernels.cpu.operators import CpuOperators
from gsfw.parallel.group import Group
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer
from gsfw.rasterizers.reference.project import project, visible_extents
from gsfw.studies.bench.pairs import contributing_pairs
from gsfw.studies.bench.steps import TrainingStep
from gsfw.studies.bench.timing import Timings
from gsfw.studies.bench.workload import Workload, scattered

CPU = torch.device("cpu")
SETTINGS = RenderSettings(background=torch.zeros(3))
REPEATS, EXCHANGES = 7, 30
"""Measurements of a step and of an exchange."""
ROWS, WIDTH, HEIGHT = 20_000, 320, 210
"""The case by which splats, pairs and pixels are measured."""
HIDDEN = 100_000
"""Gaussians behind the camera by which rows are measured."""
SMALL, LARGE = 1_000, 8_000_000
"""Bytes of the messages by which latency and speed are measured."""


@dataclass(frozen=True)
class Case:
    """A scene of one camera."""

    splats: Splats
    camera: Cameras
    view: View

    @property
    def rows(self) -> int:
        """Gaussians, seen or not."""
        return len(self.splats)

    def hiding(self, count: int) -> Case:
        """The same with so many more Gaussians behind the camera, which no view sees."""
        numbers = torch.arange(count) % self.rows
        unseen = self.splats.take(numbers)
        unseen = replace(unseen, means=unseen.means * torch.tensor([1.0, 1.0, -1.0]))
        return replace(self, splats=Splats.cat([self.splats, unseen]))


def case(rows: int, width: int, height: int) -> Case:
    """A random scene with sizes as in the workload "garden", counted."""
    splats, camera = scattered(rows, width, height, CPU)
    pairs = contributing_pairs(splats, camera, SETTINGS)
    visible, extents = visible_extents(project(splats, camera, SETTINGS), camera, SETTINGS)
    height_seen = float(2 * extents[visible, 1].mean())
    view = View(width, height, pairs / (width * height), height_seen, int(visible.sum()))
    return Case(splats, camera, view)


def step_times(scene: Case, repeats: int) -> Mapping[str, float]:
    """CPU seconds of a step and of its stages, in the median, with one thread."""
    step = TrainingStep(Workload("", scene.splats, scene.camera), CpuOperators())
    rasterizer, timings = CpuRasterizer(), Timings()
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        step.run(rasterizer, SETTINGS)
        for _ in range(repeats):
            step.measure(rasterizer, SETTINGS, timings)
            for name, reading in rasterizer.stage_times().items():
                timings.add(name, reading)
    finally:
        torch.set_num_threads(threads)
    figures = timings.figures()
    return {
        name.removesuffix("_ms"): value / 1e3
        for name, value in figures.items()
        if name.count("_ms") == 1 and not any(word in name for word in ("wall", "min_", "spread"))
    }


def compute_costs() -> Costs:
    """All constants of computing; those of the network are 0 and infinite."""
    seen = case(ROWS, WIDTH, HEIGHT)
    full = step_times(seen, REPEATS)
    held = step_times(seen.hiding(HIDDEN), REPEATS)
    ends = ("check", "optimizer")
    step_row = sum(held[name] - full[name] for name in ends) / HIDDEN
    view_row = (held["step"] - full["step"]) / HIDDEN - step_row
    pixel = full["loss"] / seen.view.pixels
    pair = (full["blend"] + full["blend_backward"]) / seen.view.pairs
    # Ten Gaussians on a picture of one tile.
    nothing = step_times(case(10, 16, 16), REPEATS)
    fixed = max(nothing["step"] - nothing["loss"], 0.0)
    rest = full["step"] - fixed - seen.rows * (step_row + view_row)
    rest -= seen.view.pixels * pixel + seen.view.pairs * pair
    return Costs(
        view_row=view_row,
        step_row=step_row,
        splat=rest / seen.view.splats(seen.rows),
        pair=pair,
        pixel=pixel,
        fixed=fixed,
        decode=decode_seconds(),
        latency=0.0,
        bytes_per_second=float("inf"),
    )


def decode_seconds() -> float:
    """CPU seconds for a pixel of a JPEG of quality 90, of a smooth picture with some noise."""
    side = 1000
    ramp = np.linspace(0, 200, side)
    noise = np.random.default_rng(0).normal(0, 4, (side, side, 3))
    picture = np.clip(ramp[:, None, None] / 2 + ramp[None, :, None] / 2 + noise, 0, 255)
    file = io.BytesIO()
    Image.fromarray(picture.astype(np.uint8)).save(file, "JPEG", quality=90)
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        np.asarray(Image.open(io.BytesIO(file.getvalue())))
        times.append(time.process_time() - began)
    return median(times) / side**2


# The network.


def network_times() -> Mapping[int, float]:
    """Least wall seconds of an all-to-all of two processes, by the bytes that each sends."""
    context = mp.get_context("spawn")
    queue = context.SimpleQueue()
    store = TCPStore("127.0.0.1", 0, is_master=True, wait_for_workers=False)
    sizes = (SMALL, LARGE // 4, LARGE)
    workers = [
        context.Process(target=_exchanging, args=(rank, store.port, sizes, queue))
        for rank in range(2)
    ]
    for worker in workers:
        worker.start()
    found: Mapping[int, float] = queue.get()
    for worker in workers:
        worker.join()
    return found


def _exchanging(
    rank: int,
    port: int,
    sizes: tuple[int, ...],
    queue: mp.SimpleQueue,  # type: ignore[type-arg]
) -> None:
    os.environ["GLOO_SOCKET_IFNAME"] = "lo"
    torch.set_num_threads(1)
    store = TCPStore("127.0.0.1", port)
    dist.init_process_group("gloo", store=store, rank=rank, world_size=2)
    group, found = Group(CPU), {}
    for size in sizes:
        sent, rooms = ([[torch.zeros(size // 8)] for _ in range(2)] for _ in range(2))
        times = []
        for _ in range(EXCHANGES):
            began = time.perf_counter()
            group.exchange_into(sent, rooms)
            times.append(time.perf_counter() - began)
        found[size] = min(times)
    if rank == 0:
        queue.put(found)
    dist.destroy_process_group()


def with_network(costs: Costs, times: Mapping[int, float]) -> Costs:
    """The costs with latency and speed, from the smallest and the largest message."""
    speed = (LARGE - SMALL) / (times[LARGE] - times[SMALL])
    return replace(costs, latency=times[SMALL], bytes_per_second=speed)
