"""`gsfw tradeoff data=DIR ...`: trains variants of a run, and recommends one of them."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.commands.interface.arguments import Arguments, layers, read_options
from gsfw.commands.interface.execution import ExecutionOptions, executor_of, resources_of
from gsfw.commands.tradeoff.verb import Budget, Target, check_budget, wish_of
from gsfw.core.ranges import number

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.core.callback import Control
    from gsfw.plugins.registry import Registry
    from gsfw.studies.runner import Ended
    from gsfw.studies.tradeoff.training.base import Base
    from gsfw.studies.tradeoff.training.experiment import Experiment, Request
    from gsfw.studies.tradeoff.training.sizing import Sizing

USUAL_METHOD = "3dgs"
"""The default method."""

OWN = (
    *("axes", "jobs", "repeats", "target", "budget", "out", "executor", "ray", "job"),
    *("json", "debug", "dry_run"),
)
"""Prefixes of this verb's own keys; all others are settings of the runs."""

OTHERS = "another tradeoff, or a run that one left behind,"


@dataclass
class TrainingBudget(Budget):
    """Bounds that must not be exceeded."""

    minutes: float | None = None
    """Duration of all training. Length and, without downscale, size of the images are chosen to
    fit; the same command continues with the remaining runs."""


@dataclass(kw_only=True)
class TrainingOptions(ExecutionOptions):
    """Without a RUN: train variants of a run, and measure quality, size and speed of each."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw tradeoff data=DIR target.psnr=30 budget.mb=20 budget.minutes=15",
        "gsfw tradeoff data=DIR method=3dgs steps=4000 axes=sh_degree,cap,strategy",
    )

    axes: tuple[str, ...] = ()
    """Axes to vary: sh_degree, sh, cap, steps, resolution, strategy, antialias. Empty:
    sh_degree,cap,steps,resolution. With steps the better half of all variants gets runs of twice
    the length, twice; without steps, all runs have one length."""
    target: Target = field(default_factory=Target)
    """Bounds that the recommended variant must reach."""
    budget: TrainingBudget = field(default_factory=TrainingBudget)
    """Bounds that must not be exceeded."""
    jobs: int = number(0, at_least=0)
    """Runs at a time, which share the cores; 0: two, where there are two cores and no GPU; with
    executor=ray as many as the cluster has resources for."""
    repeats: int = number(5, at_least=1)
    """Rounds of rendering in which the speed of every variant is measured."""
    out: str = ""
    """Folder of the runs and of tradeoff.json, .csv and .png. Empty: runs/tradeoffs/DATA."""


def run(arguments: Arguments) -> int:
    """Train, measure, print, and recommend."""
    started = time.monotonic()
    options, given = _split(arguments)
    _check(options)

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.failure import INTERRUPTED
    from gsfw.commands.interface.interrupt import stop_on_signal
    from gsfw.commands.interface.runs import RUNS
    from gsfw.core.callback import Control
    from gsfw.core.errors import OutputError
    from gsfw.core.files.folder_lock import only_one
    from gsfw.core.loop.run_folder import RunFolder
    from gsfw.plugins.registry import installed
    from gsfw.studies.report import RESULTS
    from gsfw.studies.result import ResultStore
    from gsfw.studies.tradeoff.training.base import find_capture
    from gsfw.studies.tradeoff.training.experiment import (
        Experiment,
        by_when,
        default_folder,
        usual_jobs,
    )
    from gsfw.studies.tradeoff.training.trainer import Workshop

    console, registry, control = Console(options.json), installed(), Control()
    base = _base(given, registry)
    data = str(given.get("data", ""))
    folder = Path(options.out) if options.out else default_folder(RUNS, data)
    if RunFolder(folder).config.is_file():
        raise OutputError(f"out={folder}: this folder holds a run.", "Choose another with out=DIR.")
    with only_one(folder, OTHERS) as lock, stop_on_signal(control) as interrupt:
        store = ResultStore(folder / RESULTS, f"Variants of {data or 'the built-in scene'}")
        store.write()  # A write error should appear now, not after an hour.
        deadline = by_when(started, options.budget.minutes)
        capture = find_capture(base, registry)
        here = options.executor == "local"
        jobs = options.jobs or (usual_jobs(capture) if here else 0)
        with executor_of(options, jobs, lock) as executor:
            shop = Workshop(
                registry, folder, store, control, executor, resources_of(options), deadline
            )
            experiment = Experiment(_request(options, data), base, shop, capture)
            _make(console, experiment, options, control)
            document = _report(console, experiment, options, control)
    _tell_rest(console, experiment, control, options)
    console.result(document)
    return INTERRUPTED if interrupt.received else 0


def _split(arguments: Arguments) -> tuple[TrainingOptions, dict[str, Any]]:
    """Separate this verb's options and the settings of the runs.

    Raises:
        ConfigError: an option is unknown, or has a wrong value.
    """
    own: list[tuple[str, str]] = []
    rest: list[tuple[str, str]] = []
    for key, text in arguments.pairs:
        (own if key.partition(".")[0] in OWN else rest).append((key, text))
    options = read_options("tradeoff", TrainingOptions, [f"{key}={text}" for key, text in own])
    given: dict[str, Any] = {"method": USUAL_METHOD}
    for layer in layers(Arguments((), tuple(rest))):
        given |= {key: value for key, value in layer.values.items() if layer.gives(key)}
    return options, given


def _check(options: TrainingOptions) -> None:
    """Refuse unknown axes and impossible numbers before anything is loaded."""
    from gsfw.core.errors import ConfigError
    from gsfw.plugins.registry import did_you_mean
    from gsfw.studies.tradeoff.training.axes import NAMES

    for name in options.axes:
        if name not in NAMES:
            raise ConfigError(
                f"axes={name}: there is no such axis.{did_you_mean(name, NAMES)}",
                f"Without a RUN there are {', '.join(NAMES)}.",
            )
    check_budget(options.budget)
    resources_of(options)


def _base(given: Mapping[str, Any], registry: Registry) -> Base:
    """Resolve the base settings; a key similar to one of this verb's gets that suggestion.

    Raises:
        ConfigError: a setting is unknown or wrong, or plans the length of a run by time.
    """
    from gsfw.core.errors import ConfigError
    from gsfw.plugins.keys import keys, suggest_key
    from gsfw.plugins.settings import PLANNED_BY
    from gsfw.studies.tradeoff.training.base import find_base

    for key in PLANNED_BY:
        if key in given:
            raise ConfigError(
                f"gsfw tradeoff: {key}={given[key]}: variants are compared after equal numbers of "
                "steps, which steps=N gives.",
                "The time for all variants together is budget.minutes=N.",
            )
    data = given.get("data")
    absolute = {**given, "data": str(Path(str(data)).absolute())} if data else given
    try:
        return find_base(absolute, registry)
    except ConfigError as error:
        own = [key.name for key in keys(TrainingOptions())]
        for key in given:
            hint = suggest_key(key, own)
            if f"unknown key {key!r}" in error.message and hint:
                raise ConfigError(
                    f"gsfw tradeoff: unknown key {key!r}.{hint}", "All keys: gsfw tradeoff --help"
                ) from None
        raise


def _request(options: TrainingOptions, data: str) -> Request:
    from gsfw.studies.tradeoff.training.axes import DEFAULT
    from gsfw.studies.tradeoff.training.experiment import Request

    wish = wish_of(options.target, options.budget)
    return Request(options.axes or DEFAULT, wish, options.budget.minutes, data)


def _make(
    console: Console, experiment: Experiment, options: TrainingOptions, control: Control
) -> None:
    """Choose length and size, and train; after a stop the same command continues."""
    from gsfw.commands.interface.progress import StageBars
    from gsfw.studies.tradeoff.training.trainer import Stopped

    _tell_beginning(console, experiment)
    bars = StageBars(console)
    try:
        sizing = experiment.size()
    except Stopped:
        raise KeyboardInterrupt from None
    experiment.begin(sizing)
    _tell_sizing(console, experiment, sizing, options)
    for item in experiment.rounds():
        missing = len(experiment.trainer.missing(item.trials))
        if not missing:
            continue
        with bars.stage(item.name, missing) as advance:
            for number, ended in enumerate(experiment.train(item), start=1):
                advance(number)
                _tell(console, ended)
    if control.stop_reason is None and not experiment.is_drawn:
        with bars.stage("rounds of rendering", options.repeats) as advance:
            for number in experiment.draw(options.repeats):
                advance(number)
    missing = len(experiment.without_flip)
    if control.stop_reason is None and missing:
        with bars.stage("FLIP", missing) as advance:
            for number in experiment.compare():
                advance(number)


def _tell_beginning(console: Console, experiment: Experiment) -> None:
    """Print the views and the skipped axes."""
    capture = experiment.capture
    console.say(
        f"{capture.views} views to train on, {capture.held_out} held out, "
        f"{capture.width}x{capture.height} pixels"
    )
    for item in experiment.left_out:
        console.say(f"{item.axis} is left out: {item.why}")


def _tell_sizing(
    console: Console, experiment: Experiment, sizing: Sizing, options: TrainingOptions
) -> None:
    """Print length and size, their cause, and the duration."""
    lengths = ", ".join(str(steps) for steps in experiment.search.lengths)
    at = f"downscale={sizing.downscale:g}"
    console.say(f"runs of {lengths} steps at {at}, {experiment.shop.jobs} at a time")
    if sizing.seconds is not None:
        console.say(
            f"chosen because a step takes {1e3 * sizing.step_seconds:.0f} ms and a run "
            f"{sizing.start_seconds:.0f} s besides; all of it takes about "
            f"{sizing.seconds / 60:.0f} of the {options.budget.minutes:g} minutes"
        )
        if experiment.fewer_to_start is not None:
            console.say(
                f"random_points={experiment.fewer_to_start}: more would not improve images "
                "of that size"
            )
    elif options.budget.minutes is not None:
        console.say(
            "steps and downscale are as given: runs that fit into "
            f"{options.budget.minutes:g} minutes are trained"
        )


def _tell(console: Console, ended: Ended) -> None:
    """Print a line for an ended run."""
    from gsfw.studies.tradeoff.training.trainer import PSNR

    cell = ended.run.cell
    name = f"{cell.row}, {cell.scene}"
    if ended.failure is not None:
        console.say(f"{name}: failed: {ended.failure.error}")
    elif ended.result is None:
        console.say(f"{name}: stopped; it continues another time")
    else:
        figures = ended.result.figures
        console.say(
            f"{name}: {figures[PSNR]:.2f} dB, {figures['num_gaussians']:,.0f} Gaussians, "
            f"{ended.seconds:.0f} s"
        )


def _report(
    console: Console, experiment: Experiment, options: TrainingOptions, control: Control
) -> dict[str, Any]:
    """Write the files, print the table and the recommendation; return the document."""
    from gsfw.core.errors import DataError
    from gsfw.studies.tradeoff.files import write_training_files
    from gsfw.studies.tradeoff.recommendation import recommend
    from gsfw.studies.tradeoff.training.report import offers, spread_text, table, usual_wish

    found = experiment.found()
    if not any(item.is_baseline for item in found):
        if control.stop_reason is not None:
            console.say("stopped before the baseline was made; the same command continues")
            raise KeyboardInterrupt
        raise DataError(*experiment.why_nothing())
    wish = wish_of(options.target, options.budget)
    recommended = recommend(offers(found), wish, usual_wish(found))
    about, folder = experiment.about(), experiment.shop.folder
    document = write_training_files(folder, found, recommended, about)
    console.say()
    console.table(*table(found, f"accuracy at downscale={about['downscale']:g}"))
    console.say(spread_text(found))
    console.say(f"\n{recommended.text}")
    console.say(f"written: {folder}/tradeoff.json, .csv, .png; tensorboard --logdir {folder}/tb")
    return document


def _tell_rest(
    console: Console, experiment: Experiment, control: Control, options: TrainingOptions
) -> None:
    """Print the causes of remaining runs, and the next command."""
    left = experiment.left()
    if left:
        why = control.stop_reason or f"budget.minutes={options.budget.minutes:g} is used up"
        console.say(f"{left} runs are left: {why}. The same command continues.")
