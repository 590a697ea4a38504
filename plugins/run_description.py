"""Description of a run as plain data for `gsfw info`; reads files and builds nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.config_file import HEADER, read_config

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
    settings = read_config(folder.config, everything=True).values
    steps = settings.get("steps")
    checkpoints: list[dict[str, Any]] = [
        {"step": int(path.stem.split("_")[1]), "bytes": path.stat().st_size, "path": str(path)}
        for path in sorted(folder.checkpoints.glob("step_*.pt"))
    ]
    summary = _json(folder.summary)
    done = max([0, *(item["step"] for item in checkpoints)])
    document: dict[str, Any] = {
        "kind": "run",
        "path": str(folder.path),
        **{key: settings.get(key) for key in SHOWN},
        "steps": steps,
        "steps_done": done,
        "finished": bool(summary) and done == steps,
        "metrics": summary or _last_logged(folder),
        "checkpoints": checkpoints,
        "splats": str(folder.splats) if folder.splats.is_file() else None,
        "made_by": _origin(folder.config),
    }
    requirements = _json(folder.requirements)
    if requirements:
        document["requirements"] = {key: requirements.get(key) for key in REQUIRED}
    if not document["finished"]:
        document["next"] = f"gsfw resume {folder.path}"
    return document


def _json(path: Path) -> dict[str, Any]:
    """Figures of a result file without the protocol; empty when there is none."""
    try:
        document: dict[str, Any] = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return {key: value for key, value in document.items() if key != "protocol"}


def _last_logged(folder: RunFolder) -> dict[str, Any]:
    """The last figures of the log, and those of its last evaluation."""
    try:
        lines = folder.metrics_log.read_text().splitlines()
    except OSError:
        return {}
    last: dict[str, Any] = {}
    for line in lines:
        try:
            last |= json.loads(line)
        except ValueError:
            break
    return {key: value for key, value in last.items() if not key.startswith(("lr/", "loss/"))}


def _origin(config: Path) -> dict[str, Any]:
    """Versions and the command line that made the run."""
    document = yaml.safe_load(config.read_text(encoding="utf-8")) or {}
    return {key: document[key] for key in HEADER if key in document and key != "schema"}
