"""Description of a run as plain data for `gsfw info`; reads files and builds nothing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.config_file import read_config
from gsfw.reports.run_reader import read_run
from gsfw.reports.run_record import RunRecord

SHOWN = ("method", "strategy", "rasterizer", "datamanager", "data", "device", "seed", "downscale")
"""The settings that distinguish runs; gsfw config show has them all."""

REQUIRED = (
    *("headline", "step", "total_floats", "sh_floats", "sh_floats_full"),
    *("left_out", "could_go"),
)
"""The shown entries of requirements.json, which has more."""


def describe_run(folder: RunFolder) -> dict[str, Any]:
    """The document of a run.

    Raises:
        ConfigError: its settings cannot be read.
    """
    record = read_run(folder)
    if not record.settings:
        read_config(folder.config)  # It says what is wrong with the file.
    checkpoints: list[dict[str, Any]] = [
        {"step": int(path.stem.split("_")[1]), "bytes": path.stat().st_size, "path": str(path)}
        for path in sorted(folder.checkpoints.glob("step_*.pt"))
    ]
    document: dict[str, Any] = {
        "kind": "run",
        "path": str(folder.path),
        **{key: record.settings.get(key) for key in SHOWN},
        "steps": record.settings.get("steps"),
        "steps_done": record.steps_done,
        "finished": record.is_finished,
        "metrics": _metrics(record),
        "checkpoints": checkpoints,
        "splats": str(folder.splats) if folder.splats.is_file() else None,
        "made_by": dict(record.header),
    }
    if record.requirements:
        document["requirements"] = {key: record.requirements.get(key) for key in REQUIRED}
    if not record.is_finished:
        document["next"] = f"gsfw resume {folder.path}"
    return document


def _metrics(record: RunRecord) -> Mapping[str, Any]:
    """The final figures without the protocol, or the last ones of the log."""
    if record.summary:
        return {key: value for key, value in record.summary.items() if key != "protocol"}
    last: dict[str, Any] = {}
    for line in record.log:
        last |= line
    return {key: value for key, value in last.items() if not key.startswith(("lr/", "loss/"))}
