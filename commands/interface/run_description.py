"""Description of a run for `gsfw info`, as plain data and as text; it builds nothing."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsfw.commands.interface.summary import Row, file_rows, next_rows, run_rows, summary_text
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.words import shell_argument
from gsfw.plugins.config_file import read_config
from gsfw.reports.run_reader import read_run
from gsfw.reports.run_record import RunRecord, number

SHOWN = ("method", "strategy", "rasterizer", "datamanager", "data", "device", "seed", "downscale")
"""The settings that distinguish runs; gsfw config show has them all."""

REQUIRED = (
    *("headline", "step", "total_floats", "sh_floats", "sh_floats_full"),
    *("left_out", "could_go"),
)
"""The shown entries of requirements.json, which has more."""

FIGURES = ("views", "num_gaussians", "steps", "train_seconds", "model_bytes")
"""Figures that the summary of a run has; ``render_ms`` too, if it has views."""


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
        for path in folder.all_checkpoints()
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
        "models_alone": [str(path) for path in folder.models_alone()],
        "splats": str(folder.splats) if folder.splats.is_file() else None,
        "made_by": dict(record.header),
    }
    if record.requirements:
        document["requirements"] = {key: record.requirements.get(key) for key in REQUIRED}
    if not record.is_finished:
        document["next"] = f"gsfw resume {shell_argument(folder.path)}"
    return document


def _metrics(record: RunRecord) -> Mapping[str, Any]:
    """The final figures without the protocol, or the last ones of the log."""
    if record.summary:
        return {key: value for key, value in record.summary.items() if key != "protocol"}
    last: dict[str, Any] = {}
    for line in record.log:
        last |= line
    return {key: value for key, value in last.items() if not key.startswith(("lr/", "loss/"))}


def run_text(document: Mapping[str, Any]) -> str:
    """The document of a run as a table for people, without what they seldom need.

    Args:
        document: as ``describe_run`` gives it.
    """
    folder = RunFolder(Path(document["path"]))
    record = read_run(folder)
    if record.is_finished:
        state = f"finished after {document['steps_done']:,} steps"
    else:
        steps = document["steps"]
        of = f" of {steps:,}" if isinstance(steps, int) else ""
        state = f"not finished: {document['steps_done']:,}{of} steps"
    needed = (*FIGURES, "render_ms") if record.summary.get("views") else FIGURES
    if all(number(record.summary.get(key)) is not None for key in needed):
        headline = document.get("requirements", {}).get("headline") or ""
        figures = run_rows(record.summary, record.metrics, headline)
        findings = record.summary.get("findings") or []
        figures += [Row("finding", item["message"]) for item in findings]
    else:  # The last line of a log, or the summary of an early version.
        figures = [
            Row(key.replace("_", " "), f"{value:,.6g}")
            for key, value in document["metrics"].items()
            if isinstance(value, int | float)
        ]
    following = ("view", "eval") if record.is_finished else ("resume",)
    files = [*file_rows(folder), *_checkpoint_rows(document["checkpoints"])]
    files += [Row("model alone", path, "no checkpoint") for path in document["models_alone"]]
    title = f"{folder.path}: run, {state}"
    groups = [_setting_rows(document), figures, [*files, *next_rows(str(folder.path), following)]]
    return summary_text(title, *(rows for rows in groups if rows))


def _setting_rows(document: Mapping[str, Any]) -> list[Row]:
    """Settings that distinguish runs, and the installation and the command that made this one."""
    given = {key: str(document[key]) for key in SHOWN if document[key] not in (None, "")}
    data = given.pop("data", "-")
    rows = [Row("data", data, f"format {given.pop('datamanager', '-')}")]
    rows += [Row(key, value) for key, value in given.items()]
    made = dict(document["made_by"])
    command = made.pop("command line", "")
    rows.append(Row("made by", ", ".join(f"{key} {value}" for key, value in made.items() if value)))
    return [*rows, Row("command", str(command))] if command else rows


def _checkpoint_rows(checkpoints: list[dict[str, Any]]) -> list[Row]:
    if not checkpoints:
        return [Row("checkpoints", "none")]
    last = checkpoints[-1]
    return [Row("checkpoints", str(len(checkpoints)), f"the last after {last['step']:,} steps")]
