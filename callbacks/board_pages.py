"""Text of TensorBoard, in Markdown: the run and its data, every setting, and findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gsfw.core.callback import RunInfo
from gsfw.core.loop.findings import Finding

SHOWN = (
    *("method", "strategy", "rasterizer", "datamanager", "device", "seed", "steps", "downscale"),
    *("data", "preset"),
)
"""The settings that distinguish runs; the others are on a page of their own."""


def run_page(run: RunInfo) -> str:
    """The run: its data, its parts, the protocol of its figures, and advice before the start."""
    parts = {key: run.settings[key] for key in SHOWN if run.settings.get(key) not in ("", None)}
    views = {"training views": run.views} if run.views else {}
    sections = [
        f"## {run.method} on {run.scene}",
        _table({"folder": run.folder, **views, **parts}, "run"),
    ]
    if run.notes:
        sections += ["### Advice", "\n".join(f"* {_escaped(note)}" for note in run.notes)]
    sections += ["### How figures are measured", _table(run.protocol, "protocol")]
    return "\n\n".join(sections)


def settings_page(settings: Mapping[str, Any]) -> str:
    """Every setting, in groups."""
    groups: dict[str, dict[str, Any]] = {}
    for key, value in settings.items():
        groups.setdefault(key.partition(".")[0] if "." in key else "run", {})[key] = value
    return "\n\n".join(f"### {name}\n\n{_table(group)}" for name, group in groups.items())


def findings_page(step: int, findings: Sequence[Finding]) -> str:
    """The reasons why a result is not sound after some steps, or that there are none."""
    if not findings:
        return f"There are no findings after {step:,} steps."
    items = "\n".join(f"* **{_escaped(item.key)}**: {_escaped(item.message)}" for item in findings)
    return f"After {step:,} steps:\n\n{items}"


def _table(rows: Mapping[str, Any], names: str = "setting") -> str:
    """A table of two columns; empty values are a dash."""
    lines = [f"| {names} | value |", "|---|---|"]
    lines += [f"| {_escaped(key)} | {_escaped(value) or '-'} |" for key, value in rows.items()]
    return "\n".join(lines)


def _escaped(value: object) -> str:
    """Plain text that Markdown shows as it is, in one line."""
    if isinstance(value, list | tuple):
        value = ", ".join(map(str, value))
    text = str(value).lower() if isinstance(value, bool) else " ".join(str(value).split())
    for character in "\\`*_[]<>|":
        text = text.replace(character, f"\\{character}")
    return text
