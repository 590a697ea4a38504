"""`gsfw study FILE`: makes the missing runs of a table, and prints the table."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.commands.interface.arguments import positional, read_options
from gsfw.commands.interface.execution import ExecutionOptions, executor_of, resources_of
from gsfw.core.ranges import number
from gsfw.core.words import counted, duration, rough_duration, shell_argument

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.core.callback import Control
    from gsfw.studies.comparison import SceneTable
    from gsfw.studies.planned_run import PlannedRun
    from gsfw.studies.result import ResultStore
    from gsfw.studies.runner import Ended, Runner
    from gsfw.studies.study import Study

FAILED = 1
"""Exit code if a run has failed."""

OTHERS = "another study, or a run that one left behind,"


@dataclass(kw_only=True)
class Budget:
    """Bounds of a study."""

    minutes: float | None = None
    """Start no further run after this many minutes; the same command continues later."""


@dataclass(kw_only=True)
class StudyOptions(ExecutionOptions):
    """Train a table of runs, keep finished ones, and compare: study.md, .csv, .png."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw study benchmarks/studies/dynamic.yaml root=DATA dry=true",
        "gsfw study benchmarks/studies/dynamic.yaml root=DATA only=3dgs,4dgs,robot",
        "gsfw study benchmarks/studies/dynamic.yaml table=true",
    )

    file: str = positional("FILE")
    """A .yaml file with rows, scenes and settings."""
    root: str = "."
    """Base folder of the relative data paths in the file."""
    out: str = ""
    """Folder of the study. Empty: runs/studies/NAME."""
    only: tuple[str, ...] = ()
    """Names or patterns of rows and scenes to run, such as 4d*,robot; all others wait."""
    jobs: int = number(0, at_least=0)
    """Runs at a time; 0: one, or with executor=ray as many as the cluster has resources for."""
    dry: bool = False
    """Print the runs and their estimated time, without running them."""
    table: bool = False
    """Write the tables again from results.json, without running anything."""
    again: bool = False
    """Repeat finished runs (with only=: those), for instance after a change of the code."""
    keep_runs: bool = True
    """Keep the checkpoints of finished runs."""
    budget: Budget = field(default_factory=Budget)


def run(arguments: list[str]) -> int:
    """Run a study."""
    options = read_options("study", StudyOptions, arguments)
    _check(options)

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.runs import RUNS
    from gsfw.core.files.folder_lock import only_one
    from gsfw.studies.report import RESULTS
    from gsfw.studies.result import ResultStore
    from gsfw.studies.study_file import read_study

    console = Console(options.json)
    study = read_study(Path(options.file))
    folder = Path(options.out) if options.out else RUNS / "studies" / study.name
    if options.table:
        return _table(console, study, ResultStore(folder / RESULTS, study.title), options)
    plan, missing = _plan(console, study, folder, options)
    if options.dry:
        store = ResultStore(folder / RESULTS, study.title)
        return _dry(console, plan, store, options, missing)
    with only_one(folder, OTHERS) as lock:
        store = ResultStore(folder / RESULTS, study.title)
        store.write()  # A write error should appear now, not after an hour.
        return _make(console, study, plan, store, options, lock, missing)


def _check(options: StudyOptions) -> None:
    from gsfw.core.errors import ConfigError

    resources_of(options)
    minutes = options.budget.minutes
    if minutes is not None and minutes <= 0:
        raise ConfigError(f"budget.minutes={minutes:g}: expected more than 0.")
    if options.table and (options.dry or options.again):
        raise ConfigError(
            "table=true runs nothing, so dry and again have no effect.", "Leave them out."
        )


def _plan(
    console: Console, study: Study, folder: Path, options: StudyOptions
) -> tuple[list[PlannedRun], list[str]]:
    """The chosen runs, and the scenes whose data is missing.

    Raises:
        DataError: none of them has its data.
    """
    from gsfw.core.errors import DataError
    from gsfw.plugins.registry import installed
    from gsfw.studies.planned_run import data_path, is_missing, plan_runs

    root = Path(options.root)
    cells = study.cells(options.only)
    absent = {cell.scene: data_path(cell, root) for cell in cells if is_missing(cell, root)}
    for scene, path in absent.items():
        console.warn(f"scene {scene} is left out: {path} is not there; root=DIR says where it is")
    there = [cell for cell in cells if not is_missing(cell, root)]
    if cells and not there:
        raise DataError(
            f"{options.file}: the data of none of its scenes is in {root.absolute()}.",
            "Give the folder that the paths in the file begin at with root=DIR.",
        )
    return plan_runs(there, installed(), root, folder), list(absent)


def _make(
    console: Console,
    study: Study,
    plan: Sequence[PlannedRun],
    store: ResultStore,
    options: StudyOptions,
    lock: int | None,
    missing: Sequence[str],
) -> int:
    """Make the runs, and write the report at any end."""
    from gsfw.commands.interface.failure import INTERRUPTED
    from gsfw.commands.interface.interrupt import stop_on_signal
    from gsfw.core.callback import Control
    from gsfw.studies.report import documents
    from gsfw.studies.runner import Runner, RunnerSettings

    control = Control()
    resources, minutes = resources_of(options), options.budget.minutes
    settings = RunnerSettings(resources, minutes, options.again, options.keep_runs)
    executor = executor_of(options, options.jobs, lock)
    runner = Runner(plan, store, settings, control, executor)
    about = f", about {rough_duration(runner.seconds_left())}" if runner.pending else ""
    console.say(
        f"{study.title}: {counted(runner.kept, 'run')} finished, {len(runner.pending)} left{about}"
    )
    ended: list[Ended] = []
    try:
        with stop_on_signal(control) as interrupt, executor:
            for item in runner.run():
                ended.append(item)
                _tell(console, item)
                _write(study, store, options)  # An intermediate report.
    finally:
        tables = _report(console, study, store, options)
    _tell_rest(console, runner, control, options)
    failed = [item.run.cell.name for item in ended if item.failure]
    console.result(
        {
            "results": str(store.path),
            "made": sum(item.result is not None for item in ended),
            "kept": runner.kept,
            "failed": failed,
            "left": [planned.cell.name for planned in runner.pending],
            "missing": list(missing),
            "tables": documents(tables),
        }
    )
    if interrupt.received:
        return INTERRUPTED
    return FAILED if failed else 0


def _tell(console: Console, ended: Ended) -> None:
    """Print a line for an ended run."""
    from gsfw.studies.comparison import KNOWN

    name = ended.run.cell.name
    head = f"[{ended.number}/{ended.total}] {name}: "
    if ended.failure is not None:
        advice = f"\n{ended.failure.advice}" if ended.failure.advice else ""
        console.say(f"{head}failed: {ended.failure.error}{advice}")
        return
    if ended.result is None:
        console.say(
            f"{name}: stopped; it continues another time, from its checkpoint if it has one"
        )
        return
    figures = ended.result.figures
    shown = [
        f"{KNOWN[name].heading} {KNOWN[name].text(float(figures[name]))}"
        for name in ("psnr", "moving_psnr")
        if name in figures
    ]
    left = (
        f"; about {rough_duration(ended.seconds_left)} left" if ended.number < ended.total else ""
    )
    console.say(f"{head}{', '.join([*shown, duration(ended.seconds)])}{left}")


def _tell_rest(console: Console, runner: Runner, control: Control, options: StudyOptions) -> None:
    """Print the causes of remaining runs, and the next command."""
    if not runner.pending:
        return
    why = control.stop_reason or f"budget.minutes={options.budget.minutes:g} is used up"
    further = "The same command continues."
    if options.again:
        further = "The same command trains all of them again; only=ROW,SCENE names those left."
    console.say(f"{counted(len(runner.pending), 'run')} left: {why}. {further}")


def _dry(
    console: Console,
    plan: Sequence[PlannedRun],
    store: ResultStore,
    options: StudyOptions,
    missing: Sequence[str],
) -> int:
    """List the runs with their prospects, and an estimate."""
    from gsfw.studies.runner import Estimate

    estimate = Estimate(store.results.values())
    rows: list[list[str]] = []
    listed: list[dict[str, Any]] = []
    total = 0.0
    for planned in plan:
        what = _prospect(planned, store, options.again)
        seconds = 0.0 if what == "is there" else estimate.seconds(planned)
        total += seconds
        cell = planned.cell
        about = rough_duration(seconds) if seconds else ""
        rows.append([cell.scene, cell.row, str(cell.seed), str(planned.steps), about, what])
        head = {"scene": cell.scene, "row": cell.row, "seed": cell.seed}
        listed.append({**head, "what": what, "seconds": seconds})
    console.table(["scene", "row", "seed", "steps", "about", "what"], rows)
    total /= max(1, options.jobs)
    guess = "" if estimate.is_measured else " (a guess: nothing is measured yet)"
    console.say(f"about {rough_duration(total)} in all{guess}; without dry=true they are trained")
    console.result({"runs": listed, "seconds": total, "missing": list(missing)})
    return 0


def _prospect(planned: PlannedRun, store: ResultStore, again: bool) -> str:
    """Prospect of a run in words."""
    from gsfw.plugins.values import as_text

    known = store.results.get(planned.cell.key)
    same = known is not None and known.is_of(planned)
    if again and (same or planned.is_finished()):
        return "is trained again"
    if same or planned.is_finished():
        return "is there"
    failure = store.failures.get(planned.cell.key)
    if failure is not None and not failure.resumable:
        return "has failed, is tried again"
    steps = planned.steps_done()
    if steps is not None:
        return f"continues after step {steps}"
    if known is None:
        return "is trained"
    changed = [
        f"{key}={as_text(value)} (was {as_text(known.settings.get(key))})"
        for key, value in planned.comparable(known.settings).items()
        if known.settings.get(key) != value
    ]
    return f"is trained again: {', '.join(changed[:3])}{', ...' if len(changed) > 3 else ''}"


def _table(console: Console, study: Study, store: ResultStore, options: StudyOptions) -> int:
    """Print the tables of the stored results."""
    from gsfw.core.errors import DataError
    from gsfw.studies.report import documents, shown_results

    tables = _report(console, study, store, options)
    if not shown_results(study, store):
        raise DataError(
            f"{store.path}: there are no results of {options.file} yet.",
            f"Train them with gsfw study {shell_argument(options.file)}.",
        )
    console.result({"results": str(store.path), "tables": documents(tables)})
    return 0


def _report(
    console: Console, study: Study, store: ResultStore, options: StudyOptions
) -> list[SceneTable]:
    """Write the files, and print the tables."""
    from gsfw.studies.report import table_of

    tables = _write(study, store, options)
    _warn_of_columns(console, study, store)
    for table in tables:
        shown = table_of(table)
        console.say()
        if shown.rows:
            console.table(*shown)
        else:
            console.say(table.scene)
        for line in table.lines:
            if line.note:
                console.say(f"{line.row}: {line.note}")
    if tables:
        folder = store.path.parent
        console.say(f"\nwritten: {folder}/study.md, study.csv, study.png, results.json")
    return tables


def _warn_of_columns(console: Console, study: Study, store: ResultStore) -> None:
    """Warn of columns that may be misspelt: without a known name and without a figure."""
    from gsfw.plugins.registry import did_you_mean
    from gsfw.studies.comparison import KNOWN
    from gsfw.studies.report import shown_results

    measured = {key: None for result in shown_results(study, store) for key in result.figures}
    for name in study.columns:
        if measured and name not in {**KNOWN, **measured}:
            near = did_you_mean(name, [*KNOWN, *measured])
            console.warn(f"columns: no result has a figure {name!r}.{near}")


def _write(study: Study, store: ResultStore, options: StudyOptions) -> list[SceneTable]:
    """Write the files with the results; return the tables in them."""
    from gsfw.studies.report import write_report

    words = ["gsfw", "study", options.file]
    words += ["root=DATA"] if any("data" in scene for scene in study.scenes.values()) else []
    words += [f"out={options.out}"] if options.out else []
    return write_report(study, store, store.path.parent, shlex.join(words))
