"""Result: the figures of a finished run of a study, and the file that keeps them."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gsfw.core.errors import DataError
from gsfw.core.files.json_text import parsed_json
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.studies.json_store import JsonStore, Keyed
from gsfw.studies.origin import origin
from gsfw.studies.planned_run import PlannedRun, fingerprint

MEGABYTE = 1e6
"""Bytes, as disks are sold."""

ADVICE = "Move the file away to begin anew: finished runs are found again in their folders."

RunKey = tuple[str, str, int]
"""Scene, row and seed of a run."""


@dataclass(frozen=True)
class Result(Keyed):
    """A finished run."""

    row: str
    scene: str
    seed: int
    fingerprint: str
    """Short hash of the settings."""
    given: Mapping[str, Any]
    """Settings as the study file has them."""
    settings: Mapping[str, Any]
    """Every value that the result depends on, by dotted key."""
    figures: Mapping[str, int | float]
    """Metrics, counts, seconds and megabytes by name."""
    protocol: Mapping[str, Any] = field(default_factory=dict)
    """Rules by which the metrics are measured."""
    origin: Mapping[str, Any] = field(default_factory=dict)
    """Machine and versions of the run."""
    date: str = ""
    """Year-month-day of the run."""
    run: str = ""
    """Folder of the run, which may be gone."""

    @property
    def key(self) -> RunKey:
        """Scene, row and seed."""
        return self.scene, self.row, self.seed

    def is_of(self, run: PlannedRun) -> bool:
        """True if the run has the settings of this result."""
        return self.fingerprint == fingerprint(run.comparable(self.settings))


@dataclass(frozen=True)
class Failure(Keyed):
    """A run that has ended without a result."""

    row: str
    scene: str
    seed: int
    error: str
    advice: str = ""
    resumable: bool = False
    """True if the run was cut off and can go on from its checkpoint; else it starts anew."""
    date: str = ""
    """Year-month-day of the failure."""

    @property
    def key(self) -> RunKey:
        """Scene, row and seed."""
        return self.scene, self.row, self.seed


class ResultStore(JsonStore[Result | Failure]):
    """The last result or failure of each run of a study."""

    def __init__(self, path: Path, title: str) -> None:
        """Read the file where it exists.

        Raises:
            DataError: the file is damaged, or a newer gsfw has written it.
        """
        lists: dict[str, type[Result | Failure]] = {"results": Result, "failures": Failure}
        super().__init__(path, lists, {"title": title}, ADVICE, in_order=True)

    @property
    def results(self) -> dict[RunKey, Result]:
        """Results by key."""
        return {r.key: r for r in self.records.values() if isinstance(r, Result)}

    @property
    def failures(self) -> dict[RunKey, Failure]:
        """Failures by key."""
        return {r.key: r for r in self.records.values() if isinstance(r, Failure)}


def collect(run: PlannedRun, wall_seconds: float | None = None) -> Result:
    """Read the result of a finished run from its folder.

    Args:
        run: a finished run.
        wall_seconds: from start to end of its process; ``None`` for a run that was interrupted.

    Raises:
        DataError: its result file is damaged.
    """
    path = run.folder.summary
    try:
        summary = parsed_json(path.read_text(encoding="utf-8"))
        protocol = dict(summary.pop("protocol", {}))
    except (OSError, ValueError, AttributeError, TypeError) as error:
        raise DataError(
            f"{path} cannot be read as the result of a run: {type(error).__name__}.",
            f"Remove {run.folder.path}; the run is then trained again.",
        ) from None
    sizes, threads = _checkpoint(run.folder)
    figures = _figures(summary) | sizes | _required(run.folder)
    if wall_seconds is not None:
        figures["wall_seconds"] = round(wall_seconds, 1)
    return Result(
        row=run.cell.row,
        scene=run.cell.scene,
        seed=run.cell.seed,
        fingerprint=run.fingerprint,
        given=run.cell.relevant,
        settings=dict(run.settings),
        figures=figures,
        protocol=protocol,
        origin=origin() | ({} if threads is None else {"threads": threads}),
        date=today(),
        run=str(run.folder.path),
    )


def today() -> str:
    """Year-month-day."""
    return time.strftime("%Y-%m-%d")


def _figures(document: Mapping[str, Any], prefix: str = "") -> dict[str, int | float]:
    """Every number of a summary by dotted key; lists, such as curves over time, are left out."""
    figures: dict[str, int | float] = {}
    for key, value in document.items():
        if isinstance(value, Mapping):
            figures |= _figures(value, f"{prefix}{key}.")
        elif type(value) in (int, float) and math.isfinite(value):
            figures[f"{prefix}{key}"] = value
    return figures


def _required(folder: RunFolder) -> dict[str, int | float]:
    """Floats of all parameters and of colours, and the colours' part of what all bands need."""
    try:
        found = parsed_json(folder.requirements.read_text(encoding="utf-8"))
        total, colors, full = found["total_floats"], found["sh_floats"], found["sh_floats_full"]
    except (OSError, ValueError, KeyError, TypeError):
        return {}  # A run of an earlier version, or one whose requirements could not be measured.
    share = {"sh_share": round(colors / full, 4)} if full else {}
    return {"total_floats": total, "sh_floats": colors, **share}


def _checkpoint(folder: RunFolder) -> tuple[dict[str, int | float], int | None]:
    """Read the last checkpoint, and the size of the exported splats.

    Returns:
        Megabytes of the model's own tensors, of the whole checkpoint, and of splats.ply, as far
        as they exist; and the number of training threads.
    """
    sizes: dict[str, int | float] = {}
    threads = None
    checkpoint = folder.latest_checkpoint()
    if checkpoint is not None:
        state = read_checkpoint(checkpoint)
        tensors = state["model"].values()
        sizes["megabytes"] = sum(t.numel() * t.element_size() for t in tensors) / MEGABYTE
        sizes["checkpoint_megabytes"] = checkpoint.stat().st_size / MEGABYTE
        threads = state.get("environment", {}).get("threads")
    if folder.splats.is_file():
        sizes["splats_megabytes"] = folder.splats.stat().st_size / MEGABYTE
    return {key: round(value, 3) for key, value in sizes.items()}, threads
