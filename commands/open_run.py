"""OpenRun: what RUN names, built and ready to be drawn: a run, or a model file."""

from __future__ import annotations

from pathlib import Path

from gsfw.commands.run_argument import RunArgument
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.progress import stage
from gsfw.formats.model_file import read_model_file
from gsfw.plugins.rebuild import rebuild
from gsfw.plugins.registry import Registry
from gsfw.plugins.restore import Restored, restore
from gsfw.plugins.settings import Layer


def open_run(
    found: RunArgument, registry: Registry, changed: Layer | None = None, step: int | None = None
) -> Restored:
    """The run as one of its checkpoints left it, or the model that a file holds.

    Args:
        found: what RUN names.
        registry: what is installed.
        changed: settings that replace the run's own.
        step: which checkpoint; ``None`` for the one that RUN names, or else the last.

    Raises:
        DataError: there is no such checkpoint, or a file is damaged.
        ConfigError: the settings no longer resolve, or a step is asked of a model file.
    """
    with stage(f"opening {found.name}"):
        return _open(found, registry, changed, step)


def _open(
    found: RunArgument, registry: Registry, changed: Layer | None, step: int | None
) -> Restored:
    if found.model_file is None:
        checkpoint = found.checkpoint if step is None else _checkpoint(found.folder, step)
        return restore(found.folder, registry, checkpoint, changed)
    stored = read_model_file(found.model_file)
    if step is not None:
        raise ConfigError(
            f"step={step}: {found.model_file} holds one state, that after {stored.step} steps.",
            "Leave step out, or give the run that it was exported from.",
        )
    return rebuild(stored, found.model_file, registry, changed)


def _checkpoint(folder: RunFolder, step: int) -> Path:
    """The checkpoint after ``step`` steps.

    Raises:
        DataError: there is none; lists those there are.
    """
    path = folder.checkpoint(step)
    if not path.is_file():
        steps = sorted(int(p.stem.split("_")[1]) for p in path.parent.glob("step_*.pt"))
        raise DataError(
            f"{folder.path} has no checkpoint after {step} steps.",
            f"There are checkpoints after {', '.join(map(str, steps)) or 'no'} steps.",
        )
    return path
