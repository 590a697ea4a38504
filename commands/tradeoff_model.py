"""`gsfw tradeoff RUN`: what a finished model can give up, and what that costs."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.commands.arguments import read
from gsfw.commands.run_options import RunOptions

if TYPE_CHECKING:
    from gsfw.commands.console import Console
    from gsfw.studies.tradeoff.finished_model import FinishedModel, LeftOut
    from gsfw.studies.tradeoff.recommendation import Recommendation
    from gsfw.studies.tradeoff.record import RecordStore
    from gsfw.studies.tradeoff.runner import Runner

AxisName = Literal[
    "sh",
    "prune",
    "time",
    "precision",
    "format",
    "cutoffs",
    "antialias",
    "resolution",
    "backend",
    "combined",
]
DOCUMENT, TABLE, PLOT = "tradeoff.json", "tradeoff.csv", "tradeoff.png"


@dataclass
class Target:
    """What must be reached."""

    psnr: float | None = None
    """PSNR that the recommended variant has at least, in dB."""


@dataclass
class Budget:
    """What may be spent."""

    mb: float | None = None
    """Megabytes that the file of the recommended variant has at most."""
    ms: float | None = None
    """Milliseconds that drawing a view takes at most, spread included."""


@dataclass(kw_only=True)
class ModelOptions(RunOptions):
    """Vary what can be varied of a finished model, without training, and measure what it costs."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw tradeoff latest",
        "gsfw tradeoff runs/first axes=sh,prune budget.mb=5",
        "gsfw tradeoff runs/first target.psnr=28 views=4 repeats=9 json=true",
    )

    axes: tuple[AxisName, ...] = ()
    """What is varied, each by itself; empty: everything. combined gives up several things."""
    views: int = 16
    """Most held-out views that accuracy is measured on, spread evenly."""
    repeats: int = 5
    """Rounds in which every variant is drawn for its time."""
    target: Target = field(default_factory=Target)
    """What the recommended variant must reach."""
    budget: Budget = field(default_factory=Budget)
    """What the recommended variant may cost."""
    out: str = ""
    """Folder for tradeoff.json, .csv and .png. Empty: tradeoff/ in the run, or beside the model
    file. What is measured there already is not measured again."""


def run(arguments: list[str]) -> int:
    """Measure, show, and recommend."""
    options = read("tradeoff", ModelOptions, arguments)
    _check(options)

    from gsfw.commands.console import Console
    from gsfw.commands.open_run import open_run
    from gsfw.commands.run_argument import find_run
    from gsfw.core.loop.determinism import deterministic
    from gsfw.plugins.registry import installed
    from gsfw.studies.tradeoff.catalogue import catalogue
    from gsfw.studies.tradeoff.finished_model import FinishedModel
    from gsfw.studies.tradeoff.flip import left_out as without_flip
    from gsfw.studies.tradeoff.record import RecordStore
    from gsfw.studies.tradeoff.runner import Runner
    from gsfw.studies.tradeoff.variant import AXES

    console, registry = Console(options.json), installed()
    found = find_run(options.run)
    restored = open_run(found, registry, options.changed())
    is_file = found.model_file is not None
    model = FinishedModel(restored, registry, found.name, options.views, is_file)
    variants, left_out = catalogue(model, [axis for axis in AXES if _wanted(axis, options)])
    left_out += without_flip()
    folder = Path(options.out) if options.out else found.folder.path / "tradeoff"
    store = RecordStore(folder / DOCUMENT, model.fingerprint(), _clock(model))
    _tell_beginning(console, model, store, left_out)
    runner = Runner(model, variants, store)
    with deterministic(model.device):
        try:
            _measure(console, runner, options.repeats)
        except KeyboardInterrupt:
            console.say(
                f"\nstopped; {len(store.records)} of {len(variants)} variants are measured and "
                f"kept in {store.path}: the same command goes on from there."
            )
            raise
    console.result(_report(console, model, store, left_out, options))
    return 0


def _check(options: ModelOptions) -> None:
    """Refuse numbers that measure nothing, before anything is loaded."""
    from gsfw.core.errors import ConfigError

    for name in ("views", "repeats"):
        value = getattr(options, name)
        if value < 1:
            raise ConfigError(f"{name}={value}: expected 1 or more.")
    budget = options.budget
    for name, limit in (("budget.mb", budget.mb), ("budget.ms", budget.ms)):
        if limit is not None and not limit > 0:
            raise ConfigError(f"{name}={limit:g}: expected a number above 0.")


def _clock(model: FinishedModel) -> str:
    """What times depend on besides the model: those of other conditions are not mixed."""
    import torch

    from gsfw.studies.origin import origin

    if model.device.type == "cuda":
        return torch.cuda.get_device_name(model.device)
    return f"{origin()['cpu']}, {torch.get_num_threads()} threads"


def _wanted(axis: str, options: ModelOptions) -> bool:
    return not options.axes or axis in options.axes


def _tell_beginning(
    console: Console, model: FinishedModel, store: RecordStore, left_out: list[LeftOut]
) -> None:
    """What is measured, and what is not."""
    from gsfw.studies.tradeoff.finished_model import PHOTOS

    said = f"{model.name}, step {model.restored.step}: {len(model.views)} held-out views"
    if model.against != PHOTOS:
        said += "; there are no photos, so PSNR and SSIM are against renders of the model as it is"
    console.say(said)
    for item in left_out:
        console.say(f"{item.axis} is left out: {item.why}")
    if store.forgotten:
        console.say(
            f"{store.path}: its {store.forgotten} variants are of another model or were measured "
            "in another way, and are measured anew"
        )
    elif store.records:
        console.say(f"{len(store.records)} variants are measured already")


def _measure(console: Console, runner: Runner, repeats: int) -> None:
    """Everything that is missing, with bars and the time that is left."""
    from gsfw.commands.stage_bars import StageBars

    bars = StageBars(console)
    if runner.missing:
        with bars.stage("variants", len(runner.missing)) as advance:
            for done, _ in enumerate(runner.measure(), start=1):
                advance(done)
    rounds = runner.rounds_left(repeats)
    if rounds:
        with bars.stage("rounds of timing", rounds) as advance:
            for done in runner.time(repeats):
                advance(done)


def _report(
    console: Console,
    model: FinishedModel,
    store: RecordStore,
    left_out: list[LeftOut],
    options: ModelOptions,
) -> dict[str, Any]:
    """Write the files, show the table and the recommendation; the document."""
    from gsfw.core.files.atomic import write_atomically
    from gsfw.studies.tradeoff.hyperparameters import Session, write_hyperparameters
    from gsfw.studies.tradeoff.pareto_plot import write_pareto_plot
    from gsfw.studies.tradeoff.report import (
        HEADINGS,
        csv_text,
        documents,
        in_order,
        lines,
        metrics,
    )

    records = in_order(list(store.records.values()))
    recommended = _recommended(store, options)
    document = {
        **_about(model, left_out),
        "recommended": {"text": recommended.text, "command": recommended.command},
        "variants": documents(records),
    }
    folder = store.path.parent
    store.write(document)
    write_atomically(folder / TABLE, csv_text(records).encode())
    write_pareto_plot(folder / PLOT, records)
    sessions = [
        Session(f"{r.axis} {r.name}", {"axis": r.axis, "variant": r.name}, metrics(r))
        for r in records
    ]
    write_hyperparameters(folder, sessions)
    console.say()
    console.table(HEADINGS, lines(records), "each given up by itself")
    for record in records:
        if record.failure:
            console.say(f"{record.axis} {record.name} cannot be drawn: {record.failure}")
    console.say(f"\n{recommended.text}")
    console.say(f"written: {store.path}, {TABLE}, {PLOT}")
    return {"written": str(store.path), **document}


def _recommended(store: RecordStore, options: ModelOptions) -> Recommendation:
    from gsfw.studies.tradeoff.recommendation import Wish, recommend

    wish = Wish(options.target.psnr, options.budget.mb, options.budget.ms)
    more = [f"{key}={getattr(options, key)}" for key in ("data", "device") if getattr(options, key)]
    return recommend(list(store.records.values()), wish, options.run, more)


def _about(model: FinishedModel, left_out: list[LeftOut]) -> dict[str, Any]:
    """What was measured, where, and against what."""
    import torch

    from gsfw.studies.origin import origin

    return {
        "run": model.name,
        "step": model.restored.step,
        "views": list(model.names),
        "against": model.against,
        "rasterizer": model.rasterizer,
        "device": model.device.type,
        "threads": torch.get_num_threads(),
        "machine": origin(),
        "left_out": {item.axis: item.why for item in left_out},
    }
