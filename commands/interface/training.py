"""Training: shared parts of ``train`` and ``resume``: running the loop, and reporting its end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsfw.commands.interface.console import Console
from gsfw.commands.interface.failure import INTERRUPTED, tracebacks_in
from gsfw.commands.interface.interrupt import stop_on_signal
from gsfw.commands.interface.summary import file_rows, next_rows, run_rows, summary_text
from gsfw.core.datamanager import Split
from gsfw.core.exchange import Exporter
from gsfw.core.loop.memory import release_freed_memory
from gsfw.core.loop.trainer import Trainer
from gsfw.core.progress import stage
from gsfw.core.words import shell_argument
from gsfw.formats.corrections import write_corrections
from gsfw.formats.visible_splats import without_invisible
from gsfw.kernels.cpu.native_module import keep_freed_memory, release_render_memory
from gsfw.plugins.compose import Composition
from gsfw.plugins.loading import load
from gsfw.plugins.registry import installed
from gsfw.plugins.snapshot import NOTES, snapshot
from gsfw.reports.plain_text import growth
from gsfw.reports.run_report import report_training
from gsfw.studies.requirements.report import RequirementsReport


@dataclass
class Ending:
    """Facts of the end of a run besides the figures of its summary."""

    headline: str
    """The worth of the parts of the model, as a phrase; empty if not measured."""
    invisible: int = 0
    """Gaussians that are not in splats.ply, as they are too faint to be seen."""
    learnt: Sequence[Path] = ()
    """Files of learnt exposures and cameras."""


def describe(composition: Composition) -> str:
    """Two lines: method and parts, and data."""
    settings, data = composition.settings, composition.parts.data
    choices = {slot: spec.name for slot, spec in settings.choices.items()}
    return (
        f"method {settings.method.name}, {growth(choices['strategy'])}, rasterizer "
        f"{choices['rasterizer']} on {composition.parts.device}, {composition.plan.steps} steps"
        f"{_of_processes(composition)}\n"
        f"data {composition.scene.name} ({choices['datamanager']}): "
        f"{len(data.views(Split.TRAIN))} views to train on, {len(data.views(Split.EVAL))} held "
        f"out; {len(composition.parts.table):,} Gaussians to start with"
    )


def _of_processes(composition: Composition) -> str:
    """The share of several processes in a step, as a phrase; empty for one."""
    team, sampler = composition.parts.team, composition.settings.config.sampler
    size, views = team.size, getattr(sampler, "views_per_step", 0)
    if size == 1:
        return ""
    if team.shares_rendering:
        return f", {size} processes that share the Gaussians"
    idle = f"; {size - views} without a view" if 0 < views < size else ""
    return f", {size} processes for {views or 'the'} views of a step{idle}"


def run_training(trainer: Trainer, console: Console) -> int:
    """Train to the end, or until a signal; print the result, and return the exit code.

    Raises:
        TrainingError: the GPU's memory is full, steps are no longer finite, or no checkpoint can
            hold the state of a part.
    """
    keep_freed_memory()
    recorded = tracebacks_in(trainer.folder, lambda: trainer.step > 0)
    with stop_on_signal(trainer.control) as interrupt, recorded:
        summary = train_to_end(trainer, console)
    console.result({**summary, "run": str(trainer.folder.path)})
    return INTERRUPTED if interrupt.received and not summary["completed"] else 0


def follow(trainer: Trainer) -> int:
    """Train as one of the processes that write and print nothing; return the exit code."""
    keep_freed_memory()
    try:
        with stop_on_signal(trainer.control, is_quiet=True):
            trainer.fit()
    finally:
        trainer.parts.data.close()
    return 0


def train_to_end(trainer: Trainer, console: Console) -> Mapping[str, Any]:
    """Train to the end, or until a stop is requested; write and print the results.

    Returns:
        The summary of the run.

    Raises:
        TrainingError: the GPU's memory is full, steps are no longer finite, or no checkpoint can
            hold the state of a part.
    """
    folder = trainer.folder
    report = RequirementsReport(trainer)
    console.say(f"watch it: tensorboard --logdir {shell_argument(folder.path)}")
    try:
        # After a signal the report and the requirements are left to gsfw resume.
        with folder.written_to(lambda: trainer.control.stop_reason is None):
            summary = trainer.fit(afterwards=report.make)
            ending = Ending(report.headline)
            release_render_memory()
            release_freed_memory()  # That of training and of the report.
            if summary["completed"]:
                ending.invisible = write_splats(trainer, console, summary)
                ending.learnt = write_corrections(trainer.parts, folder.path)
                if trainer.info.settings["report"]:
                    report_training(trainer)
    finally:
        trainer.parts.data.close()
    _tell(summary, trainer, console, ending)
    return summary


def write_splats(trainer: Trainer, console: Console, summary: Mapping[str, Any]) -> int:
    """Write the model as a 3DGS PLY, in the world of the data.

    Leaves out rows that are not finite or too faint to be seen; the checkpoint holds all.

    Args:
        trainer: of the run.
        console: receives the warnings.
        summary: figures of the finished run; they name what files of splats do not hold.

    Returns:
        Number of rows that the file lacks because they are too faint (opacity below 1/255); 0 if
        none was written.
    """
    parts = trainer.parts
    taken = snapshot(parts.model, parts.data.scene, trainer.plan.settings.antialias)
    content, invisible = without_invisible(taken)
    exporter: Exporter = load("exporter", installed().find("exporter", "ply"))()
    try:
        with stage(f"writing {trainer.folder.splats.name}"):
            exporter.write(trainer.folder.splats, content)
    except ValueError as error:  # The run itself is complete: its checkpoint holds everything.
        console.warn(f"no splats.ply was written: {error}")
        return 0
    for figure, note in NOTES.items():
        if figure in summary:
            console.warn(f"splats.ply: {note}")
    if taken.num_dropped:
        console.warn(f"splats.ply leaves out {taken.num_dropped} rows that are not finite")
    return invisible


def _tell(summary: Mapping[str, Any], trainer: Trainer, console: Console, ending: Ending) -> None:
    """Print the summary of a run that has ended."""
    folder, steps = trainer.folder, trainer.plan.steps
    if not summary["completed"]:
        console.say(
            f"stopped after {summary['steps']} of {steps} steps: {summary['stopped']}.\n"
            f"Continue with: gsfw resume {shell_argument(folder.path)}"
        )
        return
    findings = summary["findings"]
    done = "done" if not any(item["collapse"] for item in findings) else "done, but not sound"
    title = f"{done}: {trainer.info.method} on {trainer.info.scene}, {summary['steps']} steps"
    figures = run_rows(
        {**summary, "protocol": trainer.info.protocol},
        trainer.parts.metrics,
        ending.headline,
        ending.invisible,
    )
    files = file_rows(folder, ending.learnt)
    run = shell_argument(folder.path)
    # The report is written already, unless the settings say otherwise.
    verbs = ("view", "render", "eval") if folder.report.exists() else ("view", "render", "report")
    target = "out=scene.spz" if folder.splats.exists() else "format=ply"
    target = "format=web" if "bytes_per_time" in summary else target
    others = [f"gsfw export {run} {target}", f"tensorboard --logdir {run}"]
    following = next_rows(str(folder.path), verbs, others)
    console.say("\n" + summary_text(title, figures, [*files, *following]))
    for finding in findings:
        console.warn(finding["message"])
