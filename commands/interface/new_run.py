"""New run: the folder of a run; it is removed if training never begins."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from gsfw.commands.interface.runs import RUNS
from gsfw.core.errors import OutputError
from gsfw.core.files.atomic import readable_write_errors
from gsfw.core.loop.run_folder import RunFolder


def check_free(out: str) -> None:
    """Refuse a folder that is in use, before any work is done.

    Raises:
        OutputError: it holds a run or other files, or cannot be created.
    """
    with readable_write_errors(Path(out)):
        _check_free(out, Path(out))


def _check_free(out: str, path: Path) -> None:
    if (path / "config.yaml").exists():
        raise OutputError(
            f"out={out}: this folder holds a run already.",
            f"Go on with it: gsfw resume {out}, or choose another folder with out=DIR.",
        )
    if path.is_dir() and any(path.iterdir()):
        raise OutputError(
            f"out={out}: this folder is not empty.", "Choose a new or empty folder with out=DIR."
        )
    existing = _nearest_existing(path)
    if not existing.is_dir():
        problem = f"{existing} is not a folder"
    elif not os.access(existing, os.W_OK | os.X_OK):
        problem = f"you may not write to {existing}"
    else:
        return
    raise OutputError(f"out={out} cannot be written: {problem}.", "Choose another with out=DIR.")


def _nearest_existing(path: Path) -> Path:
    while not path.exists():
        path = path.parent
    return path


def default_folder(scene: str, method: str) -> Path:
    """``runs/SCENE/METHOD/TIME``; with a number if two runs start in the same second."""
    name = re.sub(r"[^\w.-]+", "-", scene).strip("-") or "scene"
    base = RUNS / name / method / time.strftime("%Y-%m-%d_%H-%M-%S")
    path, number = base, 2
    with readable_write_errors(base):
        while path.exists():
            path, number = base.with_name(f"{base.name}_{number}"), number + 1
    return path


@dataclass
class NewRun:
    """A run before and during its start."""

    folder: RunFolder
    steps_done: Callable[[], int] = lambda: 0
    """Number of finished steps; set once there is a trainer."""


@contextmanager
def new_run_folder(path: Path) -> Iterator[NewRun]:
    """Create the folder of a run; remove it if the run fails before its first step is done.

    The checkpoint of step 0 has no content that another start could not recreate.

    Raises:
        OutputError: it cannot be created.
    """
    run = NewRun(RunFolder(path))
    with readable_write_errors(path):
        kept = _nearest_existing(path)
        path.mkdir(parents=True, exist_ok=True)
    try:
        yield run
    except BaseException:
        if run.steps_done() == 0:
            _remove(path, kept)
        raise


def _remove(path: Path, kept: Path) -> None:
    """Remove a folder, and its empty parents that were created for it."""
    shutil.rmtree(path, ignore_errors=True)
    if path == kept:
        path.mkdir()
        return
    for parent in path.parents:
        if parent == kept or any(parent.iterdir()):
            return
        parent.rmdir()
