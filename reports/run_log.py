"""Run log: the figures of logged steps, and the notes and warnings of a run."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsfw.core.files.json_text import parsed_json

MOST_WARNINGS = 20
"""Most warnings of a log that are shown, the latest ones."""

_LOGGED = re.compile(r"^\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d+ (WARNING|ERROR|INFO) (.*)$")


@dataclass(frozen=True)
class Messages:
    """Messages of a run, each once."""

    notes: tuple[str, ...] = ()
    """Notes that it began with."""
    warnings: tuple[str, ...] = ()
    """Warnings and errors, the latest ones."""


def read_messages(path: Path) -> Messages:
    """Notes, and warnings and errors, of a log; none if it cannot be read."""
    matches = [match for line in _lines(path) if (match := _LOGGED.match(line))]
    notes = [m[2].removeprefix("note: ") for m in matches if m[2].startswith("note: ")]
    warnings = [m[2] for m in matches if m[1] != "INFO"]
    latest = tuple(dict.fromkeys(warnings))[-MOST_WARNINGS:]
    return Messages(tuple(dict.fromkeys(notes)), latest)


def read_figures(path: Path, problems: list[str]) -> tuple[Mapping[str, Any], ...]:
    """The lines of the log of figures, up to the first damaged one.

    Args:
        path: metrics.jsonl of a run.
        problems: receives a sentence if a line is damaged.
    """
    found: list[Mapping[str, Any]] = []
    for place, line in enumerate(_lines(path), start=1):
        try:
            document = parsed_json(line)
        except ValueError:
            document = None
        if not isinstance(document, dict):
            problems.append(f"{path.name} is damaged at line {place}: the curves end before it.")
            break
        found.append(document)
    return tuple(found)


def _lines(path: Path) -> list[str]:
    """The lines of a text file; none if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
