"""RUN: the argument that names a run or a model file, and the run opened for rendering."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gsfw.core.errors import ConfigError, DataError
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.registry import Registry, did_you_mean

if TYPE_CHECKING:
    from gsfw.plugins.restore import Restored
    from gsfw.plugins.settings import Layer

RUNS = Path("runs")
"""Parent folder of runs without out=DIR."""

LATEST = "latest"

MODEL_SUFFIX = ".gsfw"
"""Suffix of model files, which most verbs accept in place of a run."""


@dataclass(frozen=True)
class RunArgument:
    """The run of the argument RUN."""

    folder: RunFolder
    """Folder of results; for a model file, its parent folder."""
    checkpoint: Path | None
    """The given checkpoint; ``None`` for the latest."""
    model_file: Path | None = None
    """The given model file in place of a run."""

    @property
    def name(self) -> str:
        """Path of the run or model file, for messages and results."""
        return str(self.model_file or self.folder.path)


def find_run(text: str) -> RunArgument:
    """Find the run of RUN.

    Raises:
        DataError: there is none; suggests the nearest name.
    """
    if text == LATEST and not Path(text).exists():
        return RunArgument(RunFolder(_latest()), None)
    path = Path(text)
    if path.suffix == ".pt" and path.is_file():
        return RunArgument(RunFolder(path.resolve().parent.parent), path)
    if path.suffix == MODEL_SUFFIX and path.is_file():
        return RunArgument(RunFolder(path.parent), None, path)
    if not path.exists():
        raise DataError(f"there is no run {text}.{_nearest(path)}", _advice())
    folder = RunFolder(path)
    if not folder.config.is_file():
        raise DataError(f"{text} is not a run: it has no {folder.config.name}.", _advice())
    return RunArgument(folder, None)


def list_runs(root: Path = RUNS) -> list[Path]:
    """Folders of runs under ``root``, the newest first."""
    files = [path for path in root.glob("**/config.yaml") if path.is_file()]
    return [path.parent for path in sorted(files, key=_age, reverse=True)]


def _age(config: Path) -> tuple[float, str]:
    """Sort key of a run: its last change, then its name, which is a time."""
    return max(item.stat().st_mtime for item in (config, config.parent)), str(config)


def _latest() -> Path:
    runs = list_runs()
    if not runs:
        raise DataError(
            f"there is no latest run: {RUNS.resolve()} holds none.",
            "Give the folder of a run, or train one: gsfw train method=3dgs",
        )
    return runs[0]


def _nearest(path: Path) -> str:
    siblings = [item.name for item in path.parent.iterdir()] if path.parent.is_dir() else []
    return did_you_mean(path.name, siblings)


def _advice() -> str:
    known = list_runs()[:3]
    listed = f" Newest runs: {', '.join(map(str, known))}." if known else ""
    return (
        "RUN is the folder that gsfw train made, a checkpoint in it, a model file "
        f"({MODEL_SUFFIX}), or latest.{listed}"
    )


def open_run(
    found: RunArgument, registry: Registry, changed: Layer | None = None, step: int | None = None
) -> Restored:
    """Open a run at one of its checkpoints, or a model file.

    Args:
        found: the result of ``find_run``.
        registry: the installed parts.
        changed: settings that replace the run's own.
        step: step of the checkpoint; ``None`` for that of RUN, or else the latest.

    Raises:
        DataError: there is no such checkpoint, or a file is damaged.
        ConfigError: the settings no longer resolve, or a step is given for a model file.
    """
    from gsfw.core.progress import stage

    with stage(f"opening {found.name}"):
        return _open(found, registry, changed, step)


def _open(
    found: RunArgument, registry: Registry, changed: Layer | None, step: int | None
) -> Restored:
    from gsfw.formats.model_file import read_model_file
    from gsfw.plugins.rebuild import rebuild
    from gsfw.plugins.restore import restore

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
    """Path of the checkpoint after ``step`` steps.

    Raises:
        DataError: there is none; lists the existing ones.
    """
    path = folder.checkpoint(step)
    if not path.is_file():
        steps = sorted(int(p.stem.split("_")[1]) for p in path.parent.glob("step_*.pt"))
        raise DataError(
            f"{folder.path} has no checkpoint after {step} steps.",
            f"There are checkpoints after {', '.join(map(str, steps)) or 'no'} steps.",
        )
    return path
