"""`gsfw tradeoff data=DIR ...`: trains variants of a run, and says which one to take."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.commands.arguments import Arguments, Options, layers, read

if TYPE_CHECKING:
    from gsfw.commands.console import Console
    from gsfw.core.callback import Control
    from gsfw.plugins.registry import Registry
    from gsfw.studies.runner import Ended
    from gsfw.studies.tradeoff.training.base import Base
    from gsfw.studies.tradeoff.training.experiment import Experiment, Request
    from gsfw.studies.tradeoff.training.sizing import Sizing

USUAL_METHOD = "3dgs"
"""What is trained where no method is given."""

OWN = ("axes", "jobs", "repeats", "target", "budget", "out", "json", "debug", "dry_run")
"""Beginnings of keys that are this verb's; all others are settings of the runs."""

OTHERS = "another tradeoff, or a run that one left behind,"


@dataclass
class Target:
    """What must be reached."""

    psnr: float | None = None
    """PSNR on held-out views that the recommended variant has at least, in dB."""


@dataclass
class Budget:
    """What may be spent."""

    mb: float | None = None
    """Megabytes that the splats of the recommended variant take at most."""
    ms: float | None = None
    """Milliseconds that drawing a view takes at most, spread included."""
    minutes: float | None = None
    """Of training in all. The length and, where downscale is not given, the size of the pictures
    are chosen to fit; the same command goes on with what is left."""


@dataclass(kw_only=True)
class TrainingOptions(Options):
    """Without a RUN: train variants of a run, and measure what each gives up and gains."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw tradeoff data=DIR target.psnr=30 budget.mb=20 budget.minutes=15",
        "gsfw tradeoff data=DIR method=3dgs steps=4000 axes=sh_degree,cap,strategy",
    )

    axes: tuple[str, ...] = ()
    """What is varied, of sh_degree, sh, cap, steps, resolution, strategy and antialias. Empty:
    sh_degree,cap,steps,resolution. With steps the better half of all variants gets runs of twice
    the length, twice; without, all have one length."""
    target: Target = field(default_factory=Target)
    """What the recommended variant must reach."""
    budget: Budget = field(default_factory=Budget)
    """What may be spent."""
    jobs: int = 0
    """Runs at a time, which share the cores; 0: two, where there are two cores and no GPU."""
    repeats: int = 5
    """Rounds in which every variant is drawn for its time."""
    out: str = ""
    """Folder of the runs and of tradeoff.json, .csv and .png. Empty: runs/tradeoffs/DATA."""


def run(arguments: Arguments) -> int:
    """Train, measure, show, and recommend."""
    started = time.monotonic()
    options, given = _split(arguments)
    _check(options)

    from gsfw.commands.console import Console
    from gsfw.commands.failure import INTERRUPTED
    from gsfw.commands.interrupt import stop_on_signal
    from gsfw.commands.run_argument import RUNS
    from gsfw.core.callback import Control
    from gsfw.core.errors import OutputError
    from gsfw.core.files.folder_lock import only_one
    from gsfw.core.loop.run_folder import RunFolder
    from gsfw.plugins.registry import installed
    from gsfw.studies.result import ResultStore
    from gsfw.studies.tradeoff.training.experiment import Experiment, by_when, default_folder
    from gsfw.studies.tradeoff.training.trainer import Workshop
    from gsfw.studies.writing import RESULTS

    console, registry, control = Console(options.json), installed(), Control()
    base = _base(given, registry)
    data = str(given.get("data", ""))
    folder = Path(options.out) if options.out else default_folder(RUNS, data)
    if RunFolder(folder).config.is_file():
        raise OutputError(f"out={folder}: this folder holds a run.", "Choose another with out=DIR.")
    with only_one(folder, OTHERS) as lock, stop_on_signal(control) as interrupt:
        store = ResultStore(folder / RESULTS, f"Variants of {data or 'the built-in scene'}")
        store.write()  # Better found out now than after an hour that it cannot be.
        deadline = by_when(started, options.budget.minutes)
        shop = Workshop(registry, folder, store, control, options.jobs, deadline, lock)
        experiment = Experiment(_request(options, data), base, shop)
        _make(console, experiment, options, control)
        document = _report(console, experiment, options, control)
    _tell_rest(console, experiment, control, options)
    console.result(document)
    return INTERRUPTED if interrupt.received else 0


def _split(arguments: Arguments) -> tuple[TrainingOptions, dict[str, Any]]:
    """This verb's options, and settings of the runs.

    Raises:
        ConfigError: an option is unknown, or has a wrong value.
    """
    own: list[tuple[str, str]] = []
    rest: list[tuple[str, str]] = []
    for key, text in arguments.pairs:
        (own if key.partition(".")[0] in OWN else rest).append((key, text))
    options = read("tradeoff", TrainingOptions, [f"{key}={text}" for key, text in own])
    given: dict[str, Any] = {"method": USUAL_METHOD}
    for layer in layers(Arguments((), tuple(rest))):
        given |= {key: value for key, value in layer.values.items() if layer.gives(key)}
    return options, given


def _check(options: TrainingOptions) -> None:
    """Refuse numbers that mean nothing, before anything is loaded."""
    from gsfw.core.errors import ConfigError
    from gsfw.plugins.registry import did_you_mean
    from gsfw.studies.tradeoff.training.axes import NAMES

    for name in options.axes:
        if name not in NAMES:
            raise ConfigError(
                f"axes={name}: there is no such axis.{did_you_mean(name, NAMES)}",
                f"Without a RUN there are {', '.join(NAMES)}.",
            )
    for name, least in (("jobs", 0), ("repeats", 1)):
        value = getattr(options, name)
        if value < least:
            raise ConfigError(f"{name}={value}: expected {least} or more.")
    for name, limit in vars(options.budget).items():
        if limit is not None and not limit > 0:
            raise ConfigError(f"budget.{name}={limit:g}: expected a number above 0.")


def _base(given: Mapping[str, Any], registry: Registry) -> Base:
    """The base; a key that is nearly one of this verb's is told as such.

    Raises:
        ConfigError: a setting is unknown or wrong.
    """
    from gsfw.core.errors import ConfigError
    from gsfw.plugins.keys import keys, suggest_key
    from gsfw.studies.tradeoff.training.base import find_base

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
    from gsfw.studies.tradeoff.training.halving import Goal

    goal = Goal(options.target.psnr, options.budget.mb)
    return Request(options.axes or DEFAULT, goal, options.budget.minutes, data)


def _make(
    console: Console, experiment: Experiment, options: TrainingOptions, control: Control
) -> None:
    """Choose, say what was chosen, and train; a stop leaves the rest for another time."""
    from gsfw.commands.stage_bars import StageBars
    from gsfw.studies.tradeoff.training.speed import Stopped

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
        with bars.stage("rounds of drawing", options.repeats) as advance:
            for number in experiment.draw(options.repeats):
                advance(number)
    missing = len(experiment.without_flip)
    if control.stop_reason is None and missing:
        with bars.stage("FLIP", missing) as advance:
            for number in experiment.compare():
                advance(number)


def _tell_beginning(console: Console, experiment: Experiment) -> None:
    """What is there, and what is not."""
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
    """What was chosen and why, and how long it will take."""
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
                f"random_points={experiment.fewer_to_start}: pictures of that size have no use for "
                "more, and short runs would end before the rest are gone"
            )
    elif options.budget.minutes is not None:
        console.say(
            f"steps and downscale are as given: what fits into {options.budget.minutes:g} minutes "
            "is trained"
        )


def _tell(console: Console, ended: Ended) -> None:
    """One line for a run that has ended."""
    from gsfw.studies.tradeoff.training.trainer import PSNR

    cell = ended.run.cell
    name = f"{cell.row}, {cell.scene}"
    if ended.failure is not None:
        console.say(f"{name}: failed: {ended.failure.error}")
    elif ended.result is None:
        console.say(f"{name}: stopped; it goes on another time")
    else:
        figures = ended.result.figures
        console.say(
            f"{name}: {figures[PSNR]:.2f} dB, {figures['num_gaussians']:,.0f} Gaussians, "
            f"{ended.seconds:.0f} s"
        )


def _report(
    console: Console, experiment: Experiment, options: TrainingOptions, control: Control
) -> dict[str, Any]:
    """Write the files, show the table and the recommendation; the document."""
    from gsfw.core.errors import DataError
    from gsfw.studies.tradeoff.recommendation import Wish
    from gsfw.studies.tradeoff.training.recommendation import recommend
    from gsfw.studies.tradeoff.training.report import HEADINGS, lines, spread_text
    from gsfw.studies.tradeoff.training.writing import write_files

    found = experiment.found()
    if not any(item.is_baseline for item in found):
        if control.stop_reason is not None:
            console.say("stopped before the baseline was made; the same command goes on")
            raise KeyboardInterrupt
        raise DataError(*experiment.why_nothing())
    wish = Wish(options.target.psnr, options.budget.mb, options.budget.ms)
    recommended = recommend(found, wish)
    about, folder = experiment.about(), experiment.shop.folder
    document = write_files(folder, found, recommended, about)
    console.say()
    console.table(HEADINGS, lines(found), f"accuracy at downscale={about['downscale']:g}")
    console.say(spread_text(found))
    console.say(f"\n{recommended.text}")
    console.say(f"written: {folder}/tradeoff.json, .csv, .png; tensorboard --logdir {folder}/tb")
    return document


def _tell_rest(
    console: Console, experiment: Experiment, control: Control, options: TrainingOptions
) -> None:
    """Why runs are left, and how to go on."""
    left = experiment.left()
    if left:
        why = control.stop_reason or f"budget.minutes={options.budget.minutes:g} is over"
        console.say(f"{left} runs are left: {why}. The same command goes on.")
