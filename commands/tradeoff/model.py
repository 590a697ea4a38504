"""`gsfw tradeoff RUN`: quality, size and speed of variants of a finished model."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.commands.interface.arguments import RunOptions, read_options
from gsfw.commands.tradeoff.verb import Budget, Target, check_budget, wish_of
from gsfw.core.ranges import number
from gsfw.core.words import shell_argument

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.studies.tradeoff.finished_model import FinishedModel, LeftOut
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


@dataclass(kw_only=True)
class ModelOptions(RunOptions):
    """Vary a finished model without training, and measure quality, size and speed."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw tradeoff latest",
        "gsfw tradeoff runs/first axes=sh,prune budget.mb=5",
        "gsfw tradeoff runs/first target.psnr=28 views=4 repeats=9 json=true",
    )

    axes: tuple[AxisName, ...] = ()
    """Axes to vary, each by itself; empty: all. combined varies several at a time."""
    views: int = number(16, at_least=1)
    """Maximum number of held-out views for the accuracy, evenly spread."""
    repeats: int = number(5, at_least=1)
    """Rounds of rendering in which the speed of every variant is measured."""
    target: Target = field(default_factory=Target)
    """Bounds that the recommended variant must reach."""
    budget: Budget = field(default_factory=Budget)
    """Bounds that the recommended variant must not exceed."""
    out: str = ""
    """Folder for tradeoff.json, .csv and .png. Empty: tradeoff/ in the run, or beside the model
    file. Variants that are measured there already are not measured again."""


def run(arguments: list[str]) -> int:
    """Measure, print, and recommend."""
    options = read_options("tradeoff", ModelOptions, arguments)
    from gsfw.commands.interface.progress import load_torch

    load_torch()
    check_budget(options.budget)

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.detail import is_tree_file
    from gsfw.commands.interface.runs import find_run, restore_run
    from gsfw.core.errors import ConfigError
    from gsfw.core.loop.determinism import deterministic
    from gsfw.plugins.registry import installed
    from gsfw.studies.tradeoff.catalogue import catalogue
    from gsfw.studies.tradeoff.files import DOCUMENT
    from gsfw.studies.tradeoff.finished_model import FinishedModel
    from gsfw.studies.tradeoff.flip import left_out as without_flip
    from gsfw.studies.tradeoff.record import RecordStore
    from gsfw.studies.tradeoff.runner import Runner
    from gsfw.studies.tradeoff.variant import AXES

    console, registry = Console(options.json), installed()
    found = find_run(options.run, console.say, splats=True)
    if is_tree_file(found):
        raise ConfigError(
            f"{found.name}: tradeoff compares variants of one set of splats, and views draw cuts "
            "of a tree.",
            f"Convert it first: gsfw convert {shell_argument(found.name)} splats.ply",
        )
    restored = restore_run(found, registry, options.changed())
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
                f"kept in {store.path}: the same command continues from there."
            )
            raise
    console.result(_report(console, model, store, left_out, options))
    return 0


def _clock(model: FinishedModel) -> str:
    """Conditions of the times besides the model; times of different conditions are never mixed."""
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
    """Print the views, the skipped axes, and the known variants."""
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
    """Measure the missing variants and times, with progress bars."""
    from gsfw.commands.interface.progress import StageBars

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
    """Write the files, print the table and the recommendation; return the document."""
    from gsfw.studies.tradeoff.files import PLOT, TABLE, write_model_files
    from gsfw.studies.tradeoff.recommendation import recommend
    from gsfw.studies.tradeoff.report import in_order, offers, table, usual_wish

    records = in_order(list(store.records.values()))
    more = [f"{key}={getattr(options, key)}" for key in ("data", "device") if getattr(options, key)]
    wish = wish_of(options.target, options.budget)
    recommended = recommend(offers(records, options.run, more), wish, usual_wish(records))
    document = write_model_files(store, recommended, _about(model, left_out))
    console.say()
    console.table(*table(records))
    for record in records:
        if record.failure:
            console.say(f"{record.axis} {record.name} cannot be rendered: {record.failure}")
    console.say(f"\n{recommended.text}")
    console.say(f"written: {store.path}, {TABLE}, {PLOT}")
    return document


def _about(model: FinishedModel, left_out: list[LeftOut]) -> dict[str, Any]:
    """The model, the views and the machine, for the document."""
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
