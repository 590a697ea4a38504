"""RUN: the argument that names a run or a model file, and the run opened for rendering."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gsfw.commands.interface.run_history import remembered_runs
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.files.reading import bytes_of
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.words import shell_argument
from gsfw.plugins.registry import Registry, did_you_mean, installed, what_is_missing

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.detail import Detail
    from gsfw.plugins.compose import Composition
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
    splat_file: Path | None = None
    """The given file of splats, or folder with them, in place of a run."""

    @property
    def name(self) -> str:
        """Path of the run or file, for messages and results."""
        return str(self.model_file or self.splat_file or self.folder.path)

    def pinned(self, step: int) -> RunArgument:
        """The same from any folder, and with a later checkpoint too: that after ``step`` steps."""
        folder = RunFolder(self.folder.path.absolute())
        if self.splat_file is not None:
            return RunArgument(folder, None, splat_file=self.splat_file.absolute())
        if self.model_file is not None:
            return RunArgument(folder, None, model_file=self.model_file.absolute())
        checkpoint = folder.checkpoint(step) if self.checkpoint is None else self.checkpoint
        return RunArgument(folder, checkpoint.absolute())

    def num_bytes(self, registry: Registry) -> int | None:
        """Size of the file, with those that belong to it; ``None`` for a run.

        Raises:
            DataError: the file of splats is of no format that can be read.
        """
        from gsfw.plugins.initial_splats import find_importer

        if self.splat_file is not None:
            return find_importer(self.splat_file, registry).size(self.splat_file)
        return None if self.model_file is None else bytes_of(self.model_file)


def find_run(
    text: str, say: Callable[[str], None], splats: bool = False, lead: str = "RUN is"
) -> RunArgument:
    """Find the run of RUN.

    Args:
        text: the argument.
        say: receives a line on which run the latest is, if it is not below ``runs``.
        splats: a file of splats, or a folder with them, may be in place of a run.
        lead: first words of the advice, such as "RUN is".

    Raises:
        DataError: there is none; suggests the nearest name.
    """
    if text == LATEST and not Path(text).exists():
        return RunArgument(RunFolder(_latest(say)), None)
    path = Path(text)
    if path.suffix == ".pt" and path.is_file():
        return RunArgument(RunFolder(path.resolve().parent.parent), path)
    if path.suffix == MODEL_SUFFIX and path.is_file():
        return RunArgument(RunFolder(path.parent), None, path)
    if splats and path.is_file():
        return RunArgument(RunFolder(path.parent), None, splat_file=path)
    if not path.exists():
        kind = "run or splat file" if splats else "run"
        raise DataError(f"there is no {kind} {text}.{_nearest(path)}", _advice(splats, lead))
    folder = RunFolder(path)
    if folder.config.is_file():
        return RunArgument(folder, None)
    if not _holds_splats(path):
        _refuse_sequence(path)
        raise DataError(
            f"{text} is not a run: it has no {folder.config.name}.", _advice(splats, lead)
        )
    if splats:
        return RunArgument(RunFolder(path.parent), None, splat_file=path)
    name = shell_argument(text)
    raise DataError(
        f"{text} holds splats, and is not a run: it has no photos to compare with, and no training "
        "to continue.",
        f"For splats there are: gsfw info {name}; gsfw view {name}; gsfw render {name}; "
        f"gsfw convert {name} OUT; gsfw train method=3dgs init={name}",
    )


def _holds_splats(path: Path) -> bool:
    """True if an importer recognises a file or folder."""
    from gsfw.plugins.initial_splats import importer_of

    return importer_of(path, installed()) is not None


def _refuse_sequence(path: Path) -> None:
    """Refuse a folder of splat files, one for each time.

    Raises:
        DataError: it is one; says what opens.
    """
    from gsfw.formats.splat_sequence import files_of

    names = files_of(path)
    if names:
        raise DataError(
            f"{path} is a sequence of {len(names)} splat files, one for each time.",
            f"Give one of them, such as {path / names[0]}; or, for all times, the run that it was "
            "exported from, or its model file (gsfw export RUN format=gsfw).",
        )


def newest_runs() -> list[Path]:
    """Folders of the runs below ``runs``, and of this user's runs elsewhere; the newest first.

    A run is as old as its last start, or, where that is not remembered, its last change.
    """
    ages, local = remembered_runs(), {path.resolve(): path for path in _runs_here()}
    found = [(ages[path], path) for path in ages if path not in local and _is_run(path)]
    found += [(ages.get(real) or _changed(path), path) for real, path in local.items()]
    return [path for _, path in sorted(found, key=lambda item: (item[0], str(item[1])))][::-1]


def _runs_here() -> Iterator[Path]:
    """Folders of runs below ``runs``; the folder's name is a time, which sorts them."""
    return (path.parent for path in RUNS.glob("**/config.yaml") if path.is_file())


def _is_run(folder: Path) -> bool:
    try:
        return RunFolder(folder).config.is_file()
    except OSError:  # It is on a disk that is not there, or not ours any more.
        return False


def _changed(run: Path) -> float:
    """Last change of a run's settings or of its list of files, in seconds since 1970."""
    return max(item.stat().st_mtime for item in (run, RunFolder(run).config))


def _latest(say: Callable[[str], None]) -> Path:
    runs = newest_runs()
    if not runs:
        raise DataError(
            f"there is no latest run in {RUNS.resolve()}, and none elsewhere is known.",
            "Give the folder of a run, or train one: gsfw train method=3dgs",
        )
    if runs[0].is_absolute():
        say(f"latest is {runs[0]}, which was started or resumed last")
    return runs[0]


def _nearest(path: Path) -> str:
    if path.is_symlink():
        return f" {what_is_missing(path)}"
    siblings = [item.name for item in path.parent.iterdir()] if path.parent.is_dir() else []
    return did_you_mean(path.name, siblings)


def _advice(splats: bool, lead: str) -> str:
    known = newest_runs()[:3]
    listed = f" Newest runs: {', '.join(map(str, known))}." if known else ""
    file = "a file of splats (such as .ply), " if splats else ""
    return (
        f"{lead} the folder that gsfw train made, a checkpoint in it, a model file "
        f"({MODEL_SUFFIX}), {file}or latest.{listed}"
    )


def restore_run(
    found: RunArgument,
    registry: Registry,
    changed: Layer | None = None,
    step: int | None = None,
    detail: Detail | None = None,
) -> Restored:
    """Open a run at one of its checkpoints, or a model file.

    Args:
        found: the result of ``find_run``.
        registry: the installed parts.
        changed: settings that replace the run's own.
        step: step of the checkpoint; ``None`` for that of RUN, or else the latest.
        detail: how much is drawn; ``None``: all, and of a tree of levels of detail the usual.

    Raises:
        DataError: there is no such checkpoint, or a file is damaged.
        ConfigError: the settings no longer resolve, or a step is given for a model file; or the
            model cannot be drawn within a budget.
    """
    from gsfw.commands.interface.detail import Detail, is_tree_file, open_tree, within_budget
    from gsfw.core.progress import stage

    with stage(f"opening {found.name}"):
        if is_tree_file(found):
            assert found.splat_file is not None
            return open_tree(found.splat_file, registry, changed, detail or Detail())
        restored = _open(found, registry, changed, step)
    return within_budget(restored, detail) if detail and detail.is_given else restored


def warn_of_file(found: RunArgument, composition: Composition, console: Console) -> None:
    """Warn of what was left out of a splat file; of runs, training has told."""
    for note in composition.parts.data.notes() if found.splat_file is not None else ():
        console.warn(note)


def _open(
    found: RunArgument, registry: Registry, changed: Layer | None, step: int | None
) -> Restored:
    from gsfw.formats.model_file import read_model_file
    from gsfw.plugins.rebuild import rebuild
    from gsfw.plugins.restore import restore
    from gsfw.plugins.splat_run import open_splats

    if found.splat_file is not None:
        return open_splats(found.splat_file, registry, changed)
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
