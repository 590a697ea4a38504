"""`gsfw report RUN`: one self-contained page of a run, or of several side by side."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from gsfw.commands.interface.arguments import Options, changed_place, positionals, read_options
from gsfw.core.files.reading import names_folder
from gsfw.core.ranges import number

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import RunArgument
    from gsfw.reports.drawing import DrawingRule
    from gsfw.reports.run_report import Opened

COMPARISON = "comparison.html"
"""The page of several runs without out=FILE, in the current folder."""


@dataclass(kw_only=True)
class ReportOptions(Options):
    """Write a self-contained HTML page about a run, or a comparison of several."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw report latest",
        "gsfw report runs/first runs/second out=both.html",
        "gsfw report runs/first views=5 error=absolute",
    )

    runs: tuple[str, ...] = positionals("RUN...")
    """Run folders, checkpoints, or latest. Several are compared."""
    out: str = ""
    """File to write, or a folder for it. Empty: report.html in the run; comparison.html here for
    several runs."""
    views: int = number(9, at_least=1, at_most=18)
    """Maximum number of views with images: the worst, the median and the best. In a comparison at
    most 6, those that differ most."""
    frames: int = number(36, at_least=0, at_most=72)
    """Frames of the film around the scene; 0: none."""
    error: Literal["auto", "flip", "absolute"] = "auto"
    """Error images: flip (pip install 'gsfw[flip]'), absolute, or auto: flip if it is installed."""
    images: Literal["auto", "stored"] = "auto"
    """Source of the images: auto draws them from checkpoint and data, or takes those of an earlier
    report where it cannot; stored takes these in any case, which is quick."""
    data: str = ""
    """Place of the data set, if it was moved. Empty: that of the training."""
    device: str = ""
    """Device: auto, cpu, cuda or cuda:N. Empty: that of the training."""


def run(arguments: list[str]) -> int:
    """Write the page, and print its place."""
    options = read_options("report", ReportOptions, arguments)
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import find_run
    from gsfw.core.errors import ConfigError
    from gsfw.core.files.atomic import other_place
    from gsfw.core.words import size
    from gsfw.reports.drawing import DrawingRule
    from gsfw.reports.error_image import choose_error
    from gsfw.reports.run_report import write_run_report

    console = Console(options.json)
    found = [find_run(text, console.say) for text in options.runs]
    for argument in found:
        if argument.model_file is not None:
            raise ConfigError(
                f"{argument.name} is a model file: it has no figures to report.",
                "Give the folder of the run that it was exported from.",
            )
    rule = DrawingRule(options.views, options.frames, choose_error(options.error))
    with other_place("another place with out=FILE"):
        if len(found) == 1:
            out = _page(options.out, found[0].folder.report.name) if options.out else None
            opened = _open(found[0], options, console)
            path = write_run_report(found[0].folder, opened, rule, out)
        else:
            path = _compare(found, options, rule, console)
    count = path.stat().st_size
    console.say(f"report: {path} ({size(count)})")
    console.say(f"open it in a browser: {path.resolve().as_uri()}")
    console.result({"runs": [item.name for item in found], "report": str(path), "bytes": count})
    return 0


def _page(out: str, name: str) -> Path:
    """The path of the page: ``out``, or below it if it is a folder; else in the current folder."""
    return Path(out, name) if not out or names_folder(out) else Path(out)


def _compare(
    found: list[RunArgument], options: ReportOptions, rule: DrawingRule, console: Console
) -> Path:
    """Write the page of several runs."""
    from gsfw.reports.comparison import MOST_COMPARED, check_count, write_comparison
    from gsfw.reports.run_reader import read_run

    check_count(len(found))
    runs = [(read_run(item.folder), _open(item, options, console)) for item in found]
    limited = min(options.views, MOST_COMPARED)
    return write_comparison(runs, replace(rule, views=limited), _page(options.out, COMPARISON))


def _open(found: RunArgument, options: ReportOptions, console: Console) -> Opened:
    """The run's model; why not, if its data or a part of it is not here."""
    from gsfw.commands.interface.runs import restore_run
    from gsfw.core.errors import UserError
    from gsfw.plugins.registry import installed
    from gsfw.reports.drawing import Model
    from gsfw.reports.run_report import Opened, not_opened

    if options.images == "stored":
        return Opened(None)
    changed = changed_place(options.data, options.device)
    try:
        restored = restore_run(found, installed(), changed)
    except UserError as error:
        if changed is not None:  # What the user has just said is wrong.
            raise
        failed = not_opened(error)
        console.warn(f"{found.name} is not drawn anew: {failed.why_not}")
        return failed
    composition = restored.composition
    return Opened(Model(composition.parts, composition.plan.settings, restored.step))
