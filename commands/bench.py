"""`gsfw bench`: what drawing and a training step cost on this machine, stage by stage."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from gsfw.commands.arguments import Options, read
from gsfw.core.config import AUTO

if TYPE_CHECKING:
    from gsfw.commands.bench_round import Bench
    from gsfw.commands.bench_workload import Workload
    from gsfw.core.rasterizer import Rasterizer
    from gsfw.plugins.registry import Registry

WARM_UP = 2
"""Rounds before those that count: memory is allocated, caches are filled, threads are started."""


@dataclass(kw_only=True)
class BenchOptions(Options):
    """Measure how long drawing and a training step take on the CPU.

    Times are CPU time over all threads, and wall time beside it: medians over the repeats. Several
    rasterizers or numbers of threads take turns, so that all see the machine in the same state.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw bench",
        "gsfw bench rasterizer=cpu,reference threads=1,2 repeats=10",
        "gsfw bench rasterizer=cpu workload=FILE.npz threads=1 json=true",
    )

    rasterizer: tuple[str, ...] = (AUTO,)
    """Names, separated by commas; auto: the fastest that works here."""
    workload: str = ""
    """An npz file of splats and cameras. Empty: 100,000 random splats in front of one camera."""
    threads: tuple[int, ...] = (1,)
    """Numbers of threads to measure with, separated by commas."""
    repeats: int = 20
    """How often each is measured, after a warm-up."""


def run(arguments: list[str]) -> int:
    """Measure, and show the figures."""
    options = read("bench", BenchOptions, arguments)
    _check(options)

    from gsfw.commands.bench_limits import measure_limits, process_memory
    from gsfw.commands.bench_pairs import contributing_pairs
    from gsfw.commands.bench_report import document
    from gsfw.commands.bench_round import SETTINGS, Bench
    from gsfw.commands.bench_table import show
    from gsfw.commands.console import Console
    from gsfw.plugins.registry import installed

    console = Console(options.json)
    registry = installed()
    rasterizers = _rasterizers(options.rasterizer, registry)
    workload = _workload(options.workload)
    console.say(f"{workload.name}: {workload.description}")
    limits = measure_limits()
    with _as_in_training():
        bench = Bench(workload, rasterizers, options.threads, registry)
        _measure(bench, options.repeats)
        memory = process_memory()  # Before the count, which takes more than what is measured.
        pairs = contributing_pairs(workload.splats, workload.cameras, SETTINGS)
    result = document(bench, options.repeats, pairs, limits, memory)
    show(console, result)
    console.result(result)
    return 0


def _check(options: BenchOptions) -> None:
    """Check numbers and names before anything heavy is imported.

    Raises:
        ConfigError: naming the key, what was expected, and what was given.
    """
    from gsfw.core.errors import ConfigError

    if options.repeats < 1:
        raise ConfigError(f"repeats={options.repeats}: expected a number of at least 1.")
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


def _rasterizers(names: tuple[str, ...], registry: Registry) -> dict[str, Rasterizer]:
    """The rasterizers to measure, by name.

    Raises:
        ConfigError: one is not installed, or cannot do what a training step on the CPU needs.
    """
    import torch

    from gsfw.core.capabilities import Feature, Needs, check_fit
    from gsfw.plugins.automatic import choose_device, load, rasterizer_capabilities

    specs = {name: registry.find("rasterizer", name) for name in names if name != AUTO}
    needs = {"gsfw bench": Needs(features=frozenset({Feature.GRADIENT, Feature.SH}))}
    _, automatic = choose_device("cpu", AUTO, registry, needs)
    built: dict[str, Rasterizer] = {}
    for given in names:
        name = automatic.name if automatic and given == AUTO else given
        check_fit(name, needs, rasterizer_capabilities(registry), "cpu")
        spec = specs.get(name) or registry.find("rasterizer", name)
        built[name] = load("rasterizer", spec)().build(torch.device("cpu"))
    return built


def _workload(path: str) -> Workload:
    from gsfw.commands.bench_workload import built_in, read_workload

    return read_workload(Path(path)) if path else built_in()


@contextmanager
def _as_in_training() -> Iterator[None]:
    """Deterministic algorithms and kept memory, as in training; puts the number of threads back."""
    import torch

    from gsfw.core.determinism import deterministic
    from gsfw.kernels.cpu.native_module import keep_freed_memory

    keep_freed_memory()
    before = torch.get_num_threads()
    try:
        with deterministic(torch.device("cpu")):
            yield
    finally:
        torch.set_num_threads(before)


def _measure(bench: Bench, repeats: int) -> None:
    for index in _progress(range(WARM_UP + repeats)):
        if index == WARM_UP:
            bench.forget()
        bench.round()


def _progress(rounds: range) -> Iterable[int]:
    """The rounds, showing on a terminal how far it is."""
    from rich.console import Console as Screen
    from rich.progress import track

    screen = Screen(stderr=True)
    if not screen.is_terminal:
        return rounds
    # Drawn between rounds only: a thread that redraws it would count as CPU time of the stages.
    return track(rounds, description="rounds", console=screen, transient=True, auto_refresh=False)
