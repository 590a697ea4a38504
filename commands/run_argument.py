"""RUN: the argument that names a run: its folder, ``latest``, a checkpoint, or a model file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gsfw.core.errors import DataError
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.registry import did_you_mean

RUNS = Path("runs")
"""Where runs go that are not given a folder with out=DIR."""

LATEST = "latest"

MODEL_SUFFIX = ".gsfw"
"""Of files that hold a whole model, which most verbs take in place of a run."""


@dataclass(frozen=True)
class RunArgument:
    """The run that was named."""

    folder: RunFolder
    """Where results go; that of a model file is the folder it lies in."""
    checkpoint: Path | None
    """The checkpoint that was named; ``None`` for the last."""
    model_file: Path | None = None
    """The model file that was named in place of a run."""

    @property
    def name(self) -> str:
        """What was named, for messages and results."""
        return str(self.model_file or self.folder.path)


def find_run(text: str) -> RunArgument:
    """The run that RUN means.

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
    """When a run was last written to; names are times, and decide where that is equal."""
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
