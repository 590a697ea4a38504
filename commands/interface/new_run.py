"""New run: the folder of a run, for one process; it is removed if training never begins."""

from __future__ import annotations

import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from gsfw.commands.interface.runs import RUNS
from gsfw.core.errors import OutputError
from gsfw.core.files.atomic import PARTIAL, readable_write_errors
from gsfw.core.files.folder_lock import CLAIM, LOCK, only_one
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.words import shell_argument

OTHERS = "another gsfw train or resume"
"""The commands that are kept out of the folder of a run."""


def check_free(out: str) -> None:
    """Refuse a folder that is in use or cannot be written to, before any work is done.

    Args:
        out: the folder; empty for one below ``runs``.

    Raises:
        OutputError: it holds a run or other files, or cannot be created.
    """
    with readable_write_errors(Path(out or RUNS)):
        if not out:
            _check_writable(RUNS, f"{RUNS}, the folder of runs without out=DIR,")
        else:
            _check_empty(out)
            _check_writable(Path(out), f"out={out}")


def _check_empty(out: str) -> None:
    path = Path(out)
    if _is_remains(path):
        return
    if (path / "config.yaml").exists():
        raise OutputError(
            f"out={out}: this folder holds a run already.",
            f"Continue it: gsfw resume {shell_argument(out)}, or choose another folder with "
            "out=DIR.",
        )
    if path.is_dir() and any(item.name not in (LOCK, CLAIM) for item in path.iterdir()):
        raise OutputError(
            f"out={out}: this folder is not empty.", "Choose a new or empty folder with out=DIR."
        )


def _is_remains(path: Path) -> bool:
    """True if nothing is there, or what a training leaves that is killed before a checkpoint."""
    if not path.is_dir():
        return not path.exists()
    if not (path / LOCK).exists():
        return not any(path.iterdir())
    run = RunFolder(path)
    begun = {run.config, run.plan, run.unfinished, run.checkpoints, path / LOCK, path / CLAIM}
    if run.latest_checkpoint() is not None:
        return False
    return all(item in begun or item.name.endswith(PARTIAL) for item in path.iterdir())


def _remove_remains(path: Path) -> None:
    """Remove what a training has left that was killed before its first checkpoint."""
    for item in path.iterdir():
        if item.name not in (LOCK, CLAIM):
            shutil.rmtree(item) if item.is_dir() else item.unlink()


def _check_writable(path: Path, name: str) -> None:
    """Refuse a folder that cannot be created or written to, as a temporary file shows."""
    existing = _nearest_existing(path)
    problem = f"{existing} is not a folder"
    if existing.is_dir():
        try:
            with tempfile.TemporaryFile(dir=existing):
                return
        except OSError as error:
            problem = f"nothing can be written to {existing.resolve()} ({error.strerror})"
    raise OutputError(f"{name} cannot be written: {problem}.", "Choose another with out=DIR.")


def _nearest_existing(path: Path) -> Path:
    while not path.exists():
        path = path.parent
    return path


def default_folder(scene: str, method: str) -> Path:
    """``runs/SCENE/METHOD/TIME``; with a number if another run has that name."""
    name = re.sub(r"[^\w.-]+", "-", scene).strip("-") or "scene"
    base = RUNS / name / method / time.strftime("%Y-%m-%d_%H-%M-%S")
    with readable_write_errors(base):
        return next(path for path in _numbered(base) if not path.exists())


def _numbered(base: Path) -> Iterator[Path]:
    yield base
    for number in count(2):
        yield base.with_name(f"{base.name}_{number}")


@dataclass
class NewRun:
    """A run before and during its start."""

    folder: RunFolder
    steps_done: Callable[[], int] = lambda: 0
    """Number of finished steps; set once there is a trainer."""


@contextmanager
def new_run_folder(path: Path, is_chosen: bool = True) -> Iterator[NewRun]:
    """Create the folder of a run, and hold it; remove it if no step of the run is done.

    The checkpoint of step 0 has no content that another start could not recreate.

    Args:
        path: path of the folder.
        is_chosen: true if the user gave it; otherwise it gets a number if it is taken by now.

    Raises:
        OutputError: it cannot be created, or another run has it.
    """
    with readable_write_errors(path):
        kept = _nearest_existing(path if is_chosen else path.parent)
        path = path if is_chosen else _created(path)
    run = NewRun(RunFolder(path))
    with only_one(path, OTHERS):
        _check_empty(str(path))  # Another run may have begun, and ended, since.
        with readable_write_errors(path):
            _remove_remains(path)
        try:
            yield run
        except BaseException:
            if run.steps_done() == 0:
                _remove(path, kept)
            raise


def _created(base: Path) -> Path:
    """The first of the numbered folders that is not there yet, created."""
    base.parent.mkdir(parents=True, exist_ok=True)
    for path in _numbered(base):
        with suppress(FileExistsError):
            path.mkdir()
            break
    return path


def _remove(path: Path, kept: Path) -> None:
    """Remove a folder, and its empty parents that were created for it."""
    shutil.rmtree(path, ignore_errors=True)
    if path == kept:
        path.mkdir(exist_ok=True)
        return
    with suppress(OSError):  # Another run has begun beside it.
        for parent in path.parents:
            if parent == kept or any(parent.iterdir()):
                return
            parent.rmdir()
