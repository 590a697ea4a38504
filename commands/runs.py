"""`gsfw runs`: lists runs, compares them, and removes them."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.commands.interface.arguments import Options, positional, positionals, read_options
from gsfw.core.words import counted

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.reports.run_comparison import RunComparison
    from gsfw.reports.run_record import RunRecord

COMPARE, REMOVE = "compare", "remove"
COLUMNS = ("state", "scene", "method", "PSNR", "images", "Gaussians", "time", "run")

MOST_ADDED = 6
"""Chosen: more settings that only some runs have are counted, and not named."""


@dataclass(kw_only=True)
class RunsOptions(Options):
    """List runs: those below the folder runs, and those that you started elsewhere.

    gsfw runs compare RUN RUN shows the settings in which runs differ, and their figures side by
    side. gsfw runs remove RUN deletes the folder of a run, after asking.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw runs",
        "gsfw runs scene=fox state=finished sort=psnr",
        "gsfw runs compare runs/fox/3dgs/2026-11-23_10-00-00 latest",
        "gsfw runs remove runs/fox/3dgs/2026-11-23_10-00-00",
    )

    what: str = positional("[compare|remove]", default="")
    """compare: two or more runs side by side. remove: delete runs. Left out: list them."""
    runs: tuple[str, ...] = positionals("[RUN ...]", least=0)
    """Run folders, or latest."""
    method: str = ""
    """Only runs of this method; * stands for anything: method=4d*."""
    scene: str = ""
    """Only runs on this scene; * stands for anything."""
    state: Literal["all", "finished", "interrupted", "running", "damaged"] = "all"
    """Only runs in this state."""
    sort: Literal["newest", "psnr", "gaussians", "time", "scene", "method"] = "newest"
    """Order: the newest, the best or the fewest first."""
    yes: bool = False
    """Remove without asking."""


def run(arguments: list[str]) -> int:
    """List, compare or remove."""
    options = read_options("runs", RunsOptions, arguments)
    from gsfw.commands.interface.console import Console
    from gsfw.core.errors import ConfigError
    from gsfw.plugins.registry import did_you_mean

    console = Console(options.json)
    if options.what == COMPARE:
        return _compare(options, console)
    if options.what == REMOVE:
        return _remove(options, console)
    if options.what:
        raise ConfigError(
            f"gsfw runs: {options.what!r} is neither {COMPARE} nor {REMOVE}."
            f"{did_you_mean(options.what, (COMPARE, REMOVE))}",
            "To list runs: gsfw runs scene=NAME method=NAME state=finished.",
        )
    return _list(options, console)


def _list(options: RunsOptions, console: Console) -> int:
    from gsfw.commands.interface.run_history import remembered_runs
    from gsfw.commands.interface.runs import RUNS, newest_runs
    from gsfw.core.loop.run_folder import RunFolder
    from gsfw.reports.run_reader import read_run

    starts = remembered_runs()
    records = [read_run(RunFolder(path), starts.get(path.resolve())) for path in newest_runs()]
    chosen = sorted(filter(_filter(options), records), key=_order(options.sort))
    console.result([record.document() for record in chosen])
    if options.json:
        return 0
    if not records:
        console.say(f"there are no runs in {RUNS.resolve()}, and none elsewhere are known.")
        console.say("Train one: gsfw train method=3dgs")
    elif not chosen:
        scenes, methods = (
            {getattr(record, key) for record in records} for key in ("scene", "method")
        )
        console.say(
            f"No run matches {_filter_text(options)} ({counted(len(records), 'run')} in all)."
        )
        console.say(f"Scenes: {', '.join(sorted(scenes))}. Methods: {', '.join(sorted(methods))}.")
    else:
        console.say(_table(chosen))
        for record in chosen:
            if record.why and record.state.value == "damaged":
                console.say(f"damaged: {record.path}: {record.why}")
    return 0


def _filter(options: RunsOptions) -> Callable[[RunRecord], bool]:
    def is_wanted(record: RunRecord) -> bool:
        return (
            fnmatch(record.method, options.method or "*")
            and fnmatch(record.scene, options.scene or "*")
            and options.state in ("all", record.state.value)
        )

    return is_wanted


def _filter_text(options: RunsOptions) -> str:
    """The filter as it is written on the command line."""
    given = {"state": options.state, "scene": options.scene, "method": options.method}
    return " ".join(f"{key}={value}" for key, value in given.items() if value not in ("", "all"))


def _order(sort: str) -> Callable[[RunRecord], Any]:
    """Key of an order; the runs are the newest first already, and stay so among equals."""

    def by_figure(name: str, sign: int) -> Callable[[RunRecord], Any]:
        def key(record: RunRecord) -> float:
            value = record.figure(name)
            return float("inf") if value is None else sign * value

        return key

    orders: dict[str, Callable[[RunRecord], Any]] = {
        "newest": lambda record: 0,
        "psnr": by_figure("psnr", -1),
        "gaussians": by_figure("num_gaussians", 1),
        "time": by_figure("train_seconds", 1),
        "scene": lambda record: record.scene,
        "method": lambda record: record.method,
    }
    return orders[sort]


def _table(records: Sequence[RunRecord]) -> str:
    """One line for each run; on a narrow terminal its folder is on a line of its own."""
    rows = [list(COLUMNS), *map(_cells, records)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(COLUMNS) - 1)]
    right = (3, 4, 5, 6)
    heads = [
        "  ".join(
            cell.rjust(width) if column in right else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row[:-1], widths, strict=True))
        )
        for row in rows
    ]
    lines = [f"{head}  {row[-1]}" for head, row in zip(heads, rows, strict=True)]
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else len(max(lines))
    if sys.stdout.isatty() and max(map(len, lines)) > columns:
        # The folder unbroken, so that it can be copied.
        lines = [f"{head.rstrip()}\n  {row[-1]}" for head, row in zip(heads, rows, strict=True)]
        lines[0] = heads[0]
    return "\n".join(lines)


def _cells(record: RunRecord) -> list[str]:
    from gsfw.core.words import duration
    from gsfw.reports.plain_text import short_sizes
    from gsfw.reports.run_state import State

    state = record.state.value
    if record.state in (State.INTERRUPTED, State.RUNNING) and record.steps:
        state += f" {100 * record.steps_done // record.steps}%"
    figures: tuple[tuple[str, Callable[[float], str]], ...] = (
        ("psnr", "{:.2f}".format),
        ("num_gaussians", "{:,.0f}".format),
        ("train_seconds", duration),
    )
    cells = [
        "-" if (value := record.figure(name)) is None else text(value) for name, text in figures
    ]
    cells.insert(1, short_sizes(record.protocol) or "-")
    return [state, record.scene, record.method, *cells, str(record.path)]


def _given(options: RunsOptions, least: int, console: Console) -> list[Any]:
    """The runs of the arguments, each once.

    Raises:
        ConfigError: there are too few.
        DataError: one is no run.
    """
    from gsfw.commands.interface.runs import find_run
    from gsfw.core.errors import ConfigError

    found = {
        run.folder.path.resolve(): run
        for run in (find_run(text, console.say) for text in options.runs)
    }
    if len(found) < least:
        given = "one run is given" if found else "no run is given"
        words = "RUN RUN ..." if least > 1 else "RUN"
        raise ConfigError(
            f"gsfw runs {options.what}: {given}.",
            f"Write gsfw runs {options.what} {words}; gsfw runs lists them.",
        )
    return list(found.values())


def _compare(options: RunsOptions, console: Console) -> int:
    from gsfw.reports.plain_text import image_sizes, setting_text
    from gsfw.reports.run_comparison import RunComparison
    from gsfw.reports.run_reader import read_run

    records = [read_run(run.folder) for run in _given(options, 2, console)]
    comparison = RunComparison(tuple(records))
    console.result(comparison.document())
    letters = [chr(ord("A") + place % 26) for place in range(len(records))]
    for letter, record in zip(letters, records, strict=True):
        console.say(f"{letter}  {record.path}")
        for problem in record.problems:
            console.warn(f"{record.path}: {problem}")
    console.say()
    rows = [["state", *(f"{record.state.value}, {record.steps_done} steps" for record in records)]]
    if any(sizes := [image_sizes(record.protocol) for record in records]):
        rows.append(["images", *(size or "-" for size in sizes)])
    for figure, values in comparison.figures.items():
        rows.append([figure.name, *("-" if v is None else figure.text(v) for v in values)])
    console.table(["figure", *letters], rows)
    console.say()
    if comparison.chosen:
        chosen = [[key, *map(setting_text, comparison.settings[key])] for key in comparison.chosen]
        console.table(["setting", *letters], chosen)
    else:
        console.say("no chosen setting differs")
    _tell_others(comparison, letters, console)
    for reason in comparison.why_not(letters):
        console.warn(reason)
    return 0


def _tell_others(comparison: RunComparison, letters: Sequence[str], console: Console) -> None:
    """Name what differs though nobody chose it: packages of plugins, and settings."""
    from gsfw.reports.plain_text import setting_text

    if comparison.plugins:
        console.table(["", *letters], [["plugins", *comparison.plugins]])
    added = comparison.added if len(comparison.added) <= MOST_ADDED else {}
    for key, places in added.items():
        values = comparison.settings[key]
        owners = " and ".join(letters[place] for place in places)
        texts = ", ".join(dict.fromkeys(setting_text(values[place]) for place in places))
        console.say(f"only {owners} {'has' if len(places) == 1 else 'have'} {key} ({texts})")
    if others := len(comparison.following) - len(added):
        follow = ", and follow from these" if comparison.chosen else ""
        console.say(f"{others} more differ{follow} (json=true has them)")


def _remove(options: RunsOptions, console: Console) -> int:
    from gsfw.commands.interface.run_removal import check_removable, remove_run
    from gsfw.core.errors import ConfigError
    from gsfw.core.files.reading import bytes_of
    from gsfw.core.loop.run_folder import RunFolder
    from gsfw.core.words import size
    from gsfw.reports.run_reader import read_run

    paths = [check_removable(run) for run in _given(options, 1, console)]
    if not options.yes and (options.json or not sys.stdin.isatty()):
        raise ConfigError(
            "gsfw runs remove asks before it removes, and there is nobody to ask here.",
            "Write yes=true to remove without being asked.",
        )
    removed = []
    for path in paths:
        record = read_run(RunFolder(path))
        psnr = record.figure("psnr")
        figure = "" if psnr is None else f", PSNR {psnr:.2f} dB"
        described = f"{record.method} on {record.scene}, {record.state.value}{figure}"
        if not options.yes and not _confirmed(
            f"remove {path} ({described}, {size(bytes_of(path))})"
        ):
            console.say("kept")
            continue
        freed = remove_run(Path(path))
        removed.append({"run": str(path), "bytes": freed})
        console.say(f"removed {path}: {size(freed)} freed")
    console.result({"removed": removed, "bytes": sum(item["bytes"] for item in removed)})
    return 0


def _confirmed(question: str) -> bool:
    sys.stdout.write(f"{question}? [y/N] ")
    sys.stdout.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")
