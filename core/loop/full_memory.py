"""Full memory: no room for the next step, of a GPU or in main memory; what is kept and helps."""

from __future__ import annotations

import re
from contextlib import suppress
from traceback import clear_frames
from typing import TYPE_CHECKING

import torch

from gsfw.core.errors import NotEnoughMemoryError, TrainingError, UserError
from gsfw.core.loop.growth_limit import LIMITS
from gsfw.core.machine_memory import MachineMemory
from gsfw.core.words import shell_argument, size

if TYPE_CHECKING:
    from gsfw.core.loop.trainer import Trainer

ASKED = re.compile(r"Tried to allocate ([\d.]+ \w+)")
FREE = re.compile(r"of which ([\d.]+ \w+) is free")
"""Phrases of torch's message, which has the numbers that its error has not."""

ADVICE = (
    "Smaller images (train: downscale=2, render: scale=0.5), fewer Gaussians (render and eval: "
    "budget=500000) or device=cpu need less; nvidia-smi lists other programs on the GPU."
)
"""Remedies outside of a training loop."""


def shortage(error: BaseException) -> str:
    """The bytes that were asked for and free, as a clause with a colon; empty if torch hides them.

    Args:
        error: a ``torch.OutOfMemoryError``.
    """
    asked, free = ASKED.search(str(error)), FREE.search(str(error))
    if asked is None:
        return ""
    rest = "" if free is None else f", and {free[1]} were free"
    return f": {asked[1]} were asked for{rest}"


def memory_full(error: torch.OutOfMemoryError, trainer: Trainer) -> TrainingError:
    """The error for a run that a GPU has no room for; writes a checkpoint if the state is whole.

    The images and gradients of the unfinished step, and recorded steps, are given up first, to make
    room for that.
    """
    lack = shortage(error)
    clear_frames(error.__traceback__)
    trainer.updates.give_up()
    if trainer.parts.device.type == "cuda":
        with suppress(RuntimeError):  # It refuses after a recording that has failed.
            torch.cuda.empty_cache()
    with suppress(torch.OutOfMemoryError, UserError):  # The last one stays.
        trainer.checkpoints.keep(trainer)
    return TrainingError(
        f"the GPU's memory is full after {trainer.step} steps, with "
        f"{len(trainer.parts.table):,} Gaussians{lack}.",
        _advice(trainer, "gpu_cache_mb", "device=cpu"),
    )


def main_memory_full(trainer: Trainer, memory: MachineMemory) -> NotEnoughMemoryError:
    """The error for a run that main memory has no room for; writes a checkpoint.

    Args:
        trainer: between two steps, as those of all processes are.
        memory: that is left.
    """
    with suppress(UserError):  # The last one stays.
        trainer.checkpoints.keep(trainer, together=True)
    return NotEnoughMemoryError(
        f"memory is full after {trainer.step} steps, with {len(trainer.parts.table):,} Gaussians: "
        f"{size(memory.free + memory.swap)} are free, and {memory}.",
        _advice(trainer, "cache_mb", ""),
    )


def _advice(trainer: Trainer, cache: str, elsewhere: str) -> str:
    """The settings of this run that need less, and the state that is kept.

    Args:
        trainer: of the run.
        cache: setting of the images in this memory.
        elsewhere: setting by which the run goes on without it; empty if there is none.
    """
    settings, folder = trainer.info.settings, trainer.folder
    fewer = max(len(trainer.parts.table) // 2, 1)
    limit = next((key for key in LIMITS if key in settings), f"strategy=mcmc {LIMITS[1]}")
    less = [
        f"smaller images (downscale={2 * float(settings.get('downscale', 1)):g})",
        f"fewer Gaussians ({limit}={fewer})",
    ]
    if settings.get(cache):
        less.append(f"no images kept there ({cache}=0)")
    if trainer.plan.records_steps and trainer.parts.device.type == "cuda":
        less.append("no recorded steps (graph=off)")
    advice = f"A run needs less with {', '.join(less[:-1])} or {less[-1]}"
    if "rasterizer.pairs_mb" in settings:
        advice += "; a lower rasterizer.pairs_mb refuses single images that need much"
    kept = folder.latest_checkpoint()
    if kept is None or kept == folder.checkpoint(0):
        return f"{advice}."
    change = f"{cache}=0" if settings.get(cache) else elsewhere
    resume = f"gsfw resume {shell_argument(folder.path)} {change}".rstrip()
    return f"{advice}.\n{kept} is kept: {resume} continues from there."
