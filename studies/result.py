"""Result: the figures of a finished run of a study, small enough to keep and to send."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from gsfw.core.errors import DataError
from gsfw.core.loop.run_folder import RunFolder, read_checkpoint
from gsfw.studies.origin import origin
from gsfw.studies.planned_run import PlannedRun, fingerprint

MEGABYTE = 1e6
"""Bytes, as disks are sold."""


@dataclass(frozen=True)
class Result:
    """A finished run."""

    row: str
    scene: str
    seed: int
    fingerprint: str
    """Of the settings."""
    given: Mapping[str, Any]
    """Settings as the study file had them."""
    settings: Mapping[str, Any]
    """Every value that the result depends on."""
    figures: Mapping[str, int | float]
    """Metrics, counts, seconds, megabytes, by name."""
    protocol: Mapping[str, Any] = field(default_factory=dict)
    """How the metrics are measured."""
    origin: Mapping[str, Any] = field(default_factory=dict)
    """Machine and versions that made it."""
    date: str = ""
    """When it was made: year-month-day."""
    run: str = ""
    """Its folder, which may be gone."""

    @property
    def key(self) -> tuple[str, str, int]:
        """Scene, row and seed."""
        return self.scene, self.row, self.seed

    def is_of(self, run: PlannedRun) -> bool:
        """Whether making a run would lead to it again."""
        return self.fingerprint == fingerprint(run.comparable(self.settings))

    def document(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


@dataclass(frozen=True)
class Failure:
    """A run that ended without a result."""

    row: str
    scene: str
    seed: int
    error: str
    advice: str = ""
    resumable: bool = False
    """Whether it was cut off, and goes on from its checkpoint; else it starts anew."""
    date: str = ""
    """When: year-month-day."""

    @property
    def key(self) -> tuple[str, str, int]:
        """Scene, row and seed."""
        return self.scene, self.row, self.seed

    def document(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)


def collect(run: PlannedRun, wall_seconds: float | None = None) -> Result:
    """The result of a finished run, from its folder.

    Args:
        run: whose folder is read.
        wall_seconds: from start to end of its process, where it was made in one go.

    Raises:
        DataError: its result file is damaged.
    """
    path = run.folder.summary
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
        protocol = dict(summary.pop("protocol", {}))
    except (OSError, ValueError, AttributeError, TypeError) as error:
        raise DataError(
            f"{path} cannot be read as the result of a run: {type(error).__name__}.",
            f"Remove {run.folder.path}; the run is then made again.",
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
    """Every number of a summary by dotted key; lists, such as curves over time, stay behind."""
    figures: dict[str, int | float] = {}
    for key, value in document.items():
        if isinstance(value, Mapping):
            figures |= _figures(value, f"{prefix}{key}.")
        elif type(value) in (int, float) and math.isfinite(value):
            figures[f"{prefix}{key}"] = value
    return figures


def _required(folder: RunFolder) -> dict[str, int | float]:
    """Floats of all parameters and of colours, and the latter's part of what all bands have."""
    try:
        found = json.loads(folder.requirements.read_text(encoding="utf-8"))
        total, colors, full = found["total_floats"], found["sh_floats"], found["sh_floats_full"]
    except (OSError, ValueError, KeyError, TypeError):
        return {}  # A run of an earlier version, or one whose requirements could not be measured.
    share = {"sh_share": round(colors / full, 4)} if full else {}
    return {"total_floats": total, "sh_floats": colors, **share}


def _checkpoint(folder: RunFolder) -> tuple[dict[str, int | float], int | None]:
    """What the last checkpoint and the exported splats tell.

    Returns:
        Megabytes of the model's own tensors, of the whole checkpoint, and of splats.ply, as far
        as they are there; and the threads that trained.
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
