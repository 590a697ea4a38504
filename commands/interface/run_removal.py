"""Removal of runs: never of a folder that is no run, never of a run that is trained on."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path

import yaml

from gsfw.commands.interface.new_run import OTHERS
from gsfw.commands.interface.runs import RUNS, RunArgument
from gsfw.core.errors import ConfigError, DataError, OutputError
from gsfw.core.files.atomic import other_place
from gsfw.core.files.folder_lock import LOCK, holder, only_one
from gsfw.core.files.reading import bytes_of
from gsfw.core.files.yaml_text import parsed_yaml
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.words import shell_argument


def check_removable(found: RunArgument) -> Path:
    """The folder of a run that may be removed.

    Raises:
        ConfigError: a checkpoint or a model file is given.
        DataError: the folder is a link, no run of gsfw, holds other runs, or is the current folder
            or a parent of it.
        OutputError: it is trained on now.
    """
    path = found.folder.path
    if found.checkpoint is not None or found.model_file is not None:
        raise ConfigError(
            f"{found.checkpoint or found.model_file} is a file, and whole runs are removed.",
            f"Give the folder of the run: {path}.",
        )
    if path.is_symlink():
        raise DataError(
            f"{path} is a link to {path.resolve()}.", "Give that folder, or remove the link."
        )
    if not _is_made_by_gsfw(found.folder):
        raise DataError(
            f"{path} does not look like a run of gsfw, and is left as it is.",
            "A run has a config.yaml that names its gsfw, and checkpoints.",
        )
    here = Path.cwd()
    if here.is_relative_to(path.resolve()):
        raise DataError(
            f"{path.resolve()} cannot be removed from inside of it (you are in {here}).",
            f"Leave it first: cd {shell_argument(path.resolve().parent)}",
        )
    others = [other.parent for other in path.rglob("config.yaml") if other.parent != path]
    if others:
        raise DataError(
            f"{path} holds other runs, such as {others[0]}.", "Remove or move these first."
        )
    owner = holder(path)
    if owner is not None:
        raise OutputError(f"{path} is trained on now ({owner}).", "Wait for it, or end it.")
    return path


def _is_made_by_gsfw(folder: RunFolder) -> bool:
    """True if the files are those of a run; of a damaged one the lock and checkpoints say so."""
    try:
        document = parsed_yaml(folder.config.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        document = None
    is_ours = isinstance(document, dict) and {"gsfw", "method", "schema"} <= document.keys()
    has_lock = (folder.path / LOCK).is_file()
    has_state = folder.latest_checkpoint() is not None or folder.summary.is_file()
    return (is_ours and (has_lock or has_state)) or (has_lock and has_state)


def remove_run(path: Path) -> int:
    """Remove a run, and parent folders below ``runs`` that are empty then; the bytes freed.

    Raises:
        OutputError: somebody trains it by now, or a file cannot be removed.
    """
    path = path.resolve()  # A folder cannot be removed under a name that ends in "..".
    freed = bytes_of(path)
    waits = only_one(path, OTHERS, "Wait for it, or end it.")
    with other_place("a run that you may change"), waits:
        try:
            shutil.rmtree(path)
        except OSError as error:
            raise OutputError(
                f"{error.filename or path} cannot be removed: {error.strerror}.",
                "What is left of the run is still there; look at its permissions.",
            ) from error
    root = RUNS.resolve()
    with suppress(OSError):  # The first one that is not empty ends it.
        for parent in path.resolve().parents:
            if root not in parent.parents:
                break
            parent.rmdir()
    return freed
