"""`gsfw bench`: times of rendering and of a training step on this machine, stage by stage."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.commands.interface.arguments import Options, read_options
from gsfw.core.config import AUTO
from gsfw.core.ranges import number

if TYPE_CHECKING:
    import torch

    from gsfw.commands.interface.console import Console
    from gsfw.studies.bench.rounds import Bench
    from gsfw.studies.bench.workload import Workload
    from gsfw.studies.entrants import Entrant

WARM_UP = 2
"""Rounds before the measured ones, to allocate memory, fill caches and start threads."""


@dataclass(kw_only=True)
class BenchOptions(Options):
    """Measure how long rendering and a training step take.

    On the CPU times are CPU time over all threads, and wall time beside it; on a GPU, time of the
    GPU and wall time: medians over the repeats. Several rasterizers or numbers of threads take
    turns, so that all find the machine in the same state.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw bench",
        "gsfw bench rasterizer=cpu,reference threads=1,2 repeats=10",
        "gsfw bench rasterizer=cpu workload=FILE.npz threads=1 json=true",
        "gsfw bench rasterizer=cuda,gsplat,cuda:deterministic workload=random:1000000 sparse=true",
    )

    rasterizer: tuple[str, ...] = (AUTO,)
    """Names, separated by commas, each with settings if need be (cuda:deterministic,
    cpu:pairs_mb=100); auto: the fastest that works here."""
    device: str = AUTO
    """auto, cpu, cuda or cuda:0."""
    workload: str = ""
    """An npz file of splats and cameras, or random:COUNT for splats at 1920x1080. Empty: 100,000
    random splats in front of one camera."""
    copies: int = 1
    """Number of copies of the workload along x, and along y, around the visible one; odd."""
    size: str = ""
    """Size of the images, WIDTHxHEIGHT; empty: the workload's own."""
    threads: tuple[int, ...] = (1,)
    """Numbers of threads to measure with, separated by commas."""
    repeats: int = number(20, at_least=1)
    """Number of measurements of each, after a warm-up."""
    sparse: bool = False
    """Also measure a step in which Adam updates visible rows only."""
    agreement: int = -1
    """Compare with the float64 reference on the workload and on this many random scenes; -1: no."""
    first_use: bool = False
    """Also measure the time of a new process to its first image."""
    sort: int = 0
    """Compare our sort with torch's for this many splats, where kernels run on a GPU; 0: no."""


def run(arguments: list[str]) -> int:
    """Measure, and print the figures."""
    options = read_options("bench", BenchOptions, arguments)
    check(options)
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.core.capabilities import Feature, Needs
    from gsfw.core.render_settings import RenderSettings
    from gsfw.plugins.registry import installed
    from gsfw.studies.bench.machine import measure_limits, process_memory
    from gsfw.studies.bench.pairs import contributing_pairs
    from gsfw.studies.bench.report import document
    from gsfw.studies.bench.rounds import Bench
    from gsfw.studies.bench.timing import warm_up
    from gsfw.studies.entrants import choose_on_device

    console, registry = Console(options.json), installed()
    needs = {"gsfw bench": Needs(features=frozenset({Feature.GRADIENT, Feature.SH}))}
    entrants = choose_on_device(options.rasterizer, options.device, registry, needs)
    device = entrants[0].device
    workload = _workload(options, device)
    console.say(f"{workload.name}: {workload.description}")
    on_cpu = device.type == "cpu"
    limits = measure_limits() if on_cpu else None
    with _as_in_training(device):
        threads = options.threads if on_cpu else (0,)
        bench = Bench(workload, entrants, threads, registry, options.sparse)
        warm_up(device)
        _measure(bench, options.repeats)
        memory = process_memory()  # Before the count, which needs more memory.
        pairs = contributing_pairs(workload.splats, workload.cameras, RenderSettings())
        report = document(bench, options.repeats, pairs, limits, memory)
        report |= _more(options, workload, entrants)
    show(console, report)
    console.result(report)
    return 0


def show(console: Console, report: Mapping[str, Any]) -> None:
    """Print the document of a measurement as tables and sentences."""
    from gsfw.studies.bench.report import (
        clock_tables,
        heading,
        limits_line,
        more_tables,
        sentences,
    )

    for line in heading(report):
        console.say(line)
    for table in clock_tables(report):
        console.say()
        console.table(*table)
    console.say()
    for line in sentences(report):
        console.say(line)
    for table in more_tables(report):
        console.say()
        console.table(*table)
    if "limits" in report:
        console.say(limits_line(report["limits"]))


def check(options: BenchOptions) -> None:
    """Check numbers and names before anything heavy is imported.

    Raises:
        ConfigError: a value is wrong; names the key, the expected and the given value.
    """
    from gsfw.core.errors import ConfigError

    if options.copies < 1 or options.copies % 2 == 0:
        raise ConfigError(
            f"copies={options.copies}: expected an odd number, with the one that is seen in the "
            "middle."
        )
    if options.size:
        _size(options.size)
    for key, values in (("rasterizer", options.rasterizer), ("threads", options.threads)):
        text = ",".join(map(str, values))
        if not values:
            raise ConfigError(
                f"{key}=: expected at least one.", f"Leave {key} out for the default."
            )
        if len(set(values)) < len(values):
            raise ConfigError(f"{key}={text}: expected each only once.")
    if min(options.threads) < 1:
        text = ",".join(map(str, options.threads))
        raise ConfigError(f"threads={text}: expected numbers of at least 1.")


def _size(text: str) -> tuple[int, int]:
    """Parse WIDTHxHEIGHT.

    Raises:
        ConfigError: it is no size.
    """
    from gsfw.core.errors import ConfigError

    sides = text.split("x")
    if len(sides) != 2 or not all(side.isdecimal() and 1 <= int(side) <= 2**15 for side in sides):
        raise ConfigError(f"size={text}: expected WIDTHxHEIGHT in pixels, such as 1920x1080.")
    return int(sides[0]), int(sides[1])


def _workload(options: BenchOptions, device: torch.device) -> Workload:
    """Load or generate the workload of the options, on the device."""
    from gsfw.studies.bench.workload import RANDOM, built_in, random_workload, read_workload

    if options.workload.startswith(RANDOM):
        workload = random_workload(options.workload, device)
    elif options.workload:
        workload = read_workload(Path(options.workload)).to(device)
    else:
        workload = built_in(device)
    workload = workload.copied(options.copies)
    return workload.sized(*_size(options.size)) if options.size else workload


def _more(options: BenchOptions, workload: Workload, entrants: Sequence[Entrant]) -> dict[str, Any]:
    """Run the measurements on request."""
    from gsfw.kernels.cuda.cuda_launcher import cuda_launcher
    from gsfw.studies.bench.agreement import agreement, agreement_at_random
    from gsfw.studies.bench.first_use import first_use
    from gsfw.studies.bench.sort import compare_sorts

    found: dict[str, Any] = {}
    device, scenes = entrants[0].device, options.agreement
    if scenes >= 0:
        found["agreement"] = {
            item.name: {"workload": agreement(item, workload.splats, workload.cameras)}
            for item in entrants
        }
    if scenes > 0:
        for item in entrants:
            worst = agreement_at_random(item, scenes, device)
            found["agreement"][item.name][f"{scenes} random scenes"] = worst
    if options.first_use:
        found["first_use"] = {item.name: first_use(item.name, str(device)) for item in entrants}
    if options.sort and device.type == "cuda":
        found["sorts"] = compare_sorts(cuda_launcher(device), device, options.sort)
    return found


@contextmanager
def _as_in_training(device: torch.device) -> Iterator[None]:
    """Set up torch and memory as training does; restores the number of threads."""
    import torch

    from gsfw.core.loop.determinism import deterministic
    from gsfw.kernels.cpu.native_module import keep_freed_memory

    keep_freed_memory()
    before = torch.get_num_threads()
    try:
        with deterministic(device):
            yield
    finally:
        torch.set_num_threads(before)


def _measure(bench: Bench, repeats: int) -> None:
    for index in _progress(range(WARM_UP + repeats)):
        if index == WARM_UP:
            bench.forget()
        bench.round()


def _progress(rounds: range) -> Iterable[int]:
    """Iterate over the rounds, with a progress bar on a terminal."""
    from rich.console import Console as Screen
    from rich.progress import track

    screen = Screen(stderr=True)
    if not screen.is_terminal:
        return rounds
    # Updated between rounds only: the CPU time of an updating thread would count for the stages.
    return track(rounds, description="rounds", console=screen, transient=True, auto_refresh=False)
