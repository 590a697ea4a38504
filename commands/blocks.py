"""`gsfw blocks`: trains the blocks of a partition one by one, and merges them into one model."""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.commands.interface.arguments import parse, positional, read_options
from gsfw.commands.interface.execution import ExecutionOptions, executor_of, resources_of
from gsfw.commands.interface.progress import loading_torch
from gsfw.core.errors import ConfigError
from gsfw.core.progress import stage
from gsfw.core.ranges import number
from gsfw.core.words import duration, shell_argument, size

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.core.callback import Control
    from gsfw.jobs.executor import Executor
    from gsfw.jobs.job import Job
    from gsfw.partition.training import BlockTraining

FAILED = 1
"""Exit code if a block has failed."""
OTHERS = "another gsfw blocks, or a run that one left behind,"
REFUSED = ("out", "datamanager")
"""Settings of gsfw train that the partition decides."""
SHOWN = ("train_seconds", "peak_memory_mb", "psnr")
"""Figures of a block's run that are told."""


@dataclass(kw_only=True)
class CoarseOptions:
    """The coarse model of the whole scene, from which blocks start."""

    steps: int = number(500, at_least=0)
    """Steps of the coarse model; 0: no coarse model, blocks start from their points."""
    downscale: float = number(2.0, at_least=1, below=math.inf)
    """Downscaling of its images, on top of that of the blocks."""
    points: int = number(500_000, at_least=1)
    """Maximum number of its initial points; it does not grow."""
    rest: bool = True
    """Train blocks with the parts of it that their views see elsewhere; false: without them."""


@dataclass(kw_only=True)
class BlocksOptions(ExecutionOptions):
    """Train a coarse model, then each block alone, and merge them; the same command continues.

    Besides the keys below it takes those of gsfw train, for every block: method, steps, minutes,
    downscale, strategy.max_gaussians, ...
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw blocks city",
        "gsfw blocks city method=3dgs steps=30000 jobs=2",
        "gsfw blocks city executor=ray",
    )

    folder: str = positional("DIR")
    """The folder that gsfw partition made."""
    source: str = ""
    """Place of the data set. Empty: where it was when the partition was made."""
    jobs: int = number(0, at_least=0)
    """Blocks at a time; 0: one, or with executor=ray as many as the cluster has resources for."""
    again: bool = False
    """Train all blocks anew."""
    coarse: CoarseOptions = field(default_factory=CoarseOptions)


OWN = (*(item.name for item in fields(BlocksOptions)), "help", "ray", "job")


def run(tokens: list[str]) -> int:
    """Train what is not trained yet, and merge."""
    options, given = read(tokens)
    _check(options, given)
    with loading_torch(" and reading settings"):
        training = _training(options, given)

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.failure import INTERRUPTED
    from gsfw.commands.interface.interrupt import stop_on_signal
    from gsfw.core.callback import Control
    from gsfw.core.files.folder_lock import only_one

    console, control = Console(options.json), Control()
    with only_one(training.folder, OTHERS) as lock:
        if options.again:
            _forget(training)
        training.check_same()
        with (
            stop_on_signal(control) as interrupt,
            executor_of(options, options.jobs, lock) as executor,
        ):
            failed = _train(training, executor, control, console)
        if interrupt.received:
            console.say("stopped; the same command continues.")
            return INTERRUPTED
        if failed:
            console.say(f"not merged: {', '.join(failed)} failed; the same command tries again.")
            console.result({"failed": failed, "files": []})
            return FAILED
        return _merge(training, console)


def read(tokens: list[str]) -> tuple[BlocksOptions, dict[str, str]]:
    """The options of this verb, and the settings of the blocks."""
    arguments = parse(tokens)
    own = [f"{key}={text}" for key, text in arguments.pairs if key.partition(".")[0] in OWN]
    options = read_options("blocks", BlocksOptions, [*own, *arguments.words])
    given = {key: text for key, text in arguments.pairs if key.partition(".")[0] not in OWN}
    return options, given


def _check(options: BlocksOptions, given: dict[str, str]) -> None:
    """Check the options, and that the settings leave to the partition what is its own.

    Raises:
        ConfigError: a setting is decided by the partition.
    """
    for key in given:
        if key == "data" or key.partition(".")[0] in REFUSED:
            raise ConfigError(
                f"gsfw blocks: {key} is decided by the partition.",
                "Leave it out; source=PATH says where the data set has moved to.",
            )
    resources_of(options)


def _training(options: BlocksOptions, given: dict[str, str]) -> BlockTraining:
    """The training of all blocks, with settings that were checked.

    Raises:
        ConfigError: a setting is wrong.
        DataError: the partition or its data cannot be used.
    """
    from gsfw.partition.document import read_partition
    from gsfw.partition.training import BlockTraining, CoarseWishes
    from gsfw.planning.asked import spelled_out
    from gsfw.plugins.compose import check
    from gsfw.plugins.registry import installed
    from gsfw.plugins.settings import resolve

    partition = read_partition(Path(options.folder))
    wishes = CoarseWishes(**vars(options.coarse))
    given = {"method": "3dgs", **given}
    registry, resources = installed(), resources_of(options)
    training = BlockTraining(partition, given, wishes, registry, options.source, resources)
    settings = resolve(registry, spelled_out([training.layer()]))
    check(settings, registry)
    if "dynamic" in settings.method.tags and "static" not in settings.method.tags:
        raise ConfigError(
            f"method {settings.method.name} is for moving scenes, and blocks are merged "
            "as static models.",
            "Use a method for static scenes, such as method=3dgs.",
        )
    return training


def _forget(training: BlockTraining) -> None:
    """Remove all runs of blocks."""
    from gsfw.partition.training import COARSE, RUNS, SETTINGS, STARTS

    for name in (COARSE, STARTS, RUNS):
        shutil.rmtree(training.folder / name, ignore_errors=True)
    (training.folder / SETTINGS).unlink(missing_ok=True)


def _train(
    training: BlockTraining, executor: Executor, control: Control, console: Console
) -> list[str]:
    """Train the coarse model and the blocks; the names of those that failed."""
    coarse = training.coarse_job()
    if coarse is not None:
        failed = _do(executor, [coarse], control, console)
        if failed or control.stop_reason is not None:
            return failed
    training.write_starts()
    pending = training.pending()
    done = len(training.partition.blocks) - len(pending)
    console.say(f"blocks: {done} trained, {len(pending)} to train")
    return _do(executor, pending, control, console)


def _do(executor: Executor, jobs: Sequence[Job], control: Control, console: Console) -> list[str]:
    from gsfw.jobs.executor import outcomes

    failed: list[str] = []
    for position, (job, outcome) in enumerate(outcomes(executor, jobs, control), 1):
        head = f"[{position}/{len(jobs)}] {job.name}"
        if outcome.finished:
            psnr = outcome.document.get("psnr")
            quality = f", {psnr:.2f} dB" if isinstance(psnr, float) else ""
            console.say(f"{head}: trained in {duration(outcome.seconds)}{quality}")
        elif outcome.stopped:
            console.say(f"{head}: stopped; it continues from its checkpoint if it has one")
        else:
            failed.append(job.name)
            advice = f"\n{outcome.advice}" if outcome.advice else ""
            console.warn(f"{head} failed: {outcome.error}{advice}")
    return failed


def _merge(training: BlockTraining, console: Console) -> int:
    """Merge the blocks, and print what they hold."""
    import torch

    from gsfw.core.loop.memory import memory_summary
    from gsfw.core.loop.run_folder import RunFolder
    from gsfw.partition.merging import merge, write_merged
    from gsfw.reports.run_reader import read_run

    partition, registry = training.partition, training.registry
    runs = [training.run_of(block) for block in partition.blocks]
    with stage("merging the blocks"):
        merged = merge(partition, runs, registry)
        files = write_merged(merged, training.folder, training.layer(), registry)
    found = [
        _figures(merged.rows[block.name], read_run(RunFolder(run)).summary)
        for block, run in zip(partition.blocks, runs, strict=True)
    ]
    console.table(
        ["block", "Gaussians of its cell", "trained in", "memory", "PSNR"],
        [_row(name, figures) for name, figures in zip(merged.rows, found, strict=True)],
    )
    count = len(merged.content.splats)
    console.say(f"{count:,} Gaussians in {', '.join(map(str, files))}")
    model, data = shell_argument(files[1]), shell_argument(training.folder)
    console.say(f"Next: gsfw view {model}, or gsfw eval {model} data={data}")
    console.result(
        {
            "files": [str(path) for path in files],
            "gaussians": count,
            "blocks": dict(zip(merged.rows, found, strict=True)),
            **memory_summary(torch.device("cpu")),
        }
    )
    return 0


def _figures(own: int, summary: Mapping[str, Any]) -> dict[str, Any]:
    """Plain data of a trained block: the Gaussians of its cell, and the figures of its run."""
    return {"gaussians": own} | {key: summary[key] for key in SHOWN if key in summary}


def _row(name: str, figures: Mapping[str, Any]) -> list[str]:
    seconds, peak, psnr = (figures.get(key) for key in SHOWN)
    return [
        *(name, f"{figures['gaussians']:,}"),
        "-" if seconds is None else duration(seconds),
        size(1e6 * peak) if peak else "-",
        "-" if psnr is None else f"{psnr:.2f} dB",
    ]
