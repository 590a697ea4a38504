"""Training: shared parts of ``train`` and ``resume``: running the loop, and reporting its end."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

import torch

from gsfw.commands.interface.console import Console
from gsfw.commands.interface.failure import INTERRUPTED, tracebacks_in
from gsfw.commands.interface.interrupt import stop_on_signal
from gsfw.core.datamanager import Split
from gsfw.core.errors import TrainingError
from gsfw.core.exchange import Exporter
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.core.progress import stage
from gsfw.formats.corrections import write_corrections
from gsfw.formats.visible_splats import without_invisible
from gsfw.kernels.cpu.native_module import keep_freed_memory
from gsfw.plugins.compose import Composition
from gsfw.plugins.loading import load
from gsfw.plugins.registry import installed
from gsfw.plugins.snapshot import snapshot
from gsfw.reports.run_report import report_training
from gsfw.studies.requirements.report import RequirementsReport


def describe(composition: Composition) -> str:
    """Two lines: method and parts, and data."""
    settings, data = composition.settings, composition.parts.data
    choices = {slot: spec.name for slot, spec in settings.choices.items()}
    return (
        f"method {settings.method.name}, strategy {choices['strategy']}, rasterizer "
        f"{choices['rasterizer']} on {composition.parts.device}, {composition.plan.steps} steps\n"
        f"data {composition.scene.name} ({choices['datamanager']}): "
        f"{len(data.views(Split.TRAIN))} views to train on, {len(data.views(Split.EVAL))} held "
        f"out; {len(composition.parts.table):,} Gaussians to start with"
    )


def run_training(trainer: Trainer, console: Console) -> int:
    """Train to the end, or until a signal; print the result, and return the exit code.

    Raises:
        TrainingError: the GPU's memory is full, or steps are no longer finite.
    """
    folder = trainer.folder
    keep_freed_memory()
    report = RequirementsReport(trainer)
    console.say(f"watch it: tensorboard --logdir {quoted(folder)}")
    try:
        recorded = tracebacks_in(folder, lambda: trainer.step > 0)
        with stop_on_signal(trainer.control) as interrupt, recorded:
            summary = _fit(trainer, report)
            if summary["completed"]:
                write_splats(trainer, console)
                for path in write_corrections(trainer.parts, folder.path):
                    console.say(f"learnt of the capture: {path}")
            page = report_training(trainer) if trainer.info.settings["report"] else None
    finally:
        trainer.parts.data.close()
    _tell(summary, trainer, console, report.line)
    if page is not None:
        console.say(f"one page to look at and to send: {page}")
    console.result({**summary, "run": str(folder.path)})
    return INTERRUPTED if interrupt.received and not summary["completed"] else 0


def _fit(trainer: Trainer, report: RequirementsReport) -> dict[str, Any]:
    try:
        return trainer.fit(afterwards=report.make)
    except torch.OutOfMemoryError:
        raise TrainingError(
            f"the GPU's memory is full after {trainer.step} steps, with "
            f"{len(trainer.parts.table):,} Gaussians.",
            "Keep no images there (gpu_cache_mb=0), shrink them (downscale=2), or limit the "
            "number of Gaussians (strategy=mcmc strategy.cap_max=500000).",
        ) from None


def write_splats(trainer: Trainer, console: Console) -> None:
    """Write the model as a 3DGS PLY, in the world of the data.

    Leaves out rows that are not finite or too faint to be seen; the checkpoint holds all.
    """
    parts = trainer.parts
    taken = snapshot(parts.model, parts.data.scene, trainer.plan.settings.antialias)
    content, invisible = without_invisible(taken.content)
    exporter: Exporter = load("exporter", installed().find("exporter", "ply"))()
    try:
        with stage(f"writing {trainer.folder.splats.name}"):
            exporter.write(trainer.folder.splats, content)
    except ValueError as error:  # The run itself is complete: its checkpoint holds everything.
        console.warn(f"no splats.ply was written: {error}")
    if taken.num_dropped:
        console.warn(f"splats.ply leaves out {taken.num_dropped} rows that are not finite")
    if invisible:
        console.say(
            f"splats.ply leaves out {invisible:,} of {len(taken.content.splats):,} Gaussians that "
            "are too faint to be seen (opacity below 1/255)"
        )


def quoted(folder: RunFolder) -> str:
    """The folder, quoted for a shell."""
    return shlex.quote(str(folder.path))


def _tell(
    summary: Mapping[str, Any], trainer: Trainer, console: Console, requirements: str
) -> None:
    run = quoted(trainer.folder)
    if not summary["completed"]:
        console.say(
            f"stopped after {summary['steps']} of {trainer.plan.steps} steps: {summary['stopped']}."
        )
        console.say(f"Go on with: gsfw resume {run}")
        return
    figures = "".join(
        f", {name.upper()} {summary[name]:.{digits}f}{unit}"
        for name, digits, unit in (("psnr", 2, " dB"), ("ssim", 4, ""))
        if name in summary
    )
    if "moving_psnr" in summary:
        figures += f", of what moves PSNR {summary['moving_psnr']:.2f} dB"
    findings = summary["findings"]
    done = "done" if not any(item["collapse"] for item in findings) else "done, but not sound"
    console.say(
        f"{done}: {summary['steps']} steps in {summary['train_seconds']:.0f} s of training, "
        f"{summary['num_gaussians']:,} Gaussians{_size(summary)}"
    )
    console.say(f"held-out views: {summary['views']}{figures}{_baseline(summary)}")
    for finding in findings:
        console.warn(finding["message"])
    if requirements:
        console.say(requirements)
    console.say(f"everything is in {run}")
    export = "" if trainer.folder.splats.exists() else f"\n  gsfw export {run} format=ply"
    console.say(
        f"next:\n  tensorboard --logdir {run}\n  gsfw eval {run}\n  gsfw render {run}{export}"
    )


def _baseline(summary: Mapping[str, Any]) -> str:
    """The figure to beat; nothing without held-out views."""
    constant = summary.get("baselines", {}).get("constant_psnr")
    return "" if constant is None else f" (a single colour has {constant:.2f} dB)"


def _size(summary: Mapping[str, Any]) -> str:
    """The size of a model of a moving scene; nothing for a static one."""
    if "bytes_per_time" not in summary:
        return ""
    model, time = summary["model_bytes"] / 1e6, summary["bytes_per_time"] / 1e6
    return f", {model:.2f} MB, {time:.3f} MB per captured time"
