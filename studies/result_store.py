"""ResultStore: the results of a study in one file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from gsfw.core.errors import DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text, read_document
from gsfw.studies.result import Failure, Result

SCHEMA = 1
"""Number of the layout; raised when an older gsfw could not read a newer file."""

ADVICE = "Move it away to begin anew: runs that are finished are found again in their folders."
"""What to do with a file that is not one of these."""

TYPES = (
    *((name, str, "text") for name in ("row", "scene", "fingerprint", "date", "run")),
    *((name, str, "text") for name in ("error", "advice")),
    *((name, dict, "an object") for name in ("given", "settings", "figures", "protocol", "origin")),
    ("seed", int, "a whole number"),
    ("resumable", bool, "true or false"),
)
"""Of each field of a result or a failure: its type, and how that is said."""

Key = tuple[str, str, int]
Record = TypeVar("Record", Result, Failure)


class ResultStore:
    """Results and failures by scene, row and seed; each change is on disk before it returns."""

    def __init__(self, path: Path, title: str) -> None:
        """Read what is there.

        Raises:
            DataError: the file is damaged, or was written by a newer gsfw.
        """
        self.path, self.title = path, title
        self.results: dict[Key, Result] = {}
        self.failures: dict[Key, Failure] = {}
        if path.exists():
            document = read_document(path, SCHEMA, ADVICE)
            self.results = _records(path, document, "results", Result)
            self.failures = _records(path, document, "failures", Failure)

    def keep(self, result: Result) -> None:
        """Add a result, in place of an earlier one or of a failure.

        Raises:
            OutputError: the file cannot be written.
        """
        self.results[result.key] = result
        self.failures.pop(result.key, None)
        self.write()

    def keep_failure(self, failure: Failure) -> None:
        """Add a failure; an earlier result with other settings goes.

        Raises:
            OutputError: the file cannot be written.
        """
        self.failures[failure.key] = failure
        self.results.pop(failure.key, None)
        self.write()

    def forget(self, key: Key) -> None:
        """Drop what is known of a run.

        Raises:
            OutputError: the file cannot be written.
        """
        if key in self.results or key in self.failures:
            self.results.pop(key, None)
            self.failures.pop(key, None)
            self.write()

    def write(self) -> None:
        """Write everything, whole or not at all.

        Raises:
            OutputError: the file cannot be written.
        """
        document = {
            "schema": SCHEMA,
            "title": self.title,
            "results": [self.results[key].document() for key in sorted(self.results)],
            "failures": [self.failures[key].document() for key in sorted(self.failures)],
        }
        write_atomically(self.path, (json_text(document, indent=1) + "\n").encode())


def _records(
    path: Path, document: Mapping[str, Any], name: str, kind: type[Record]
) -> dict[Key, Record]:
    known = {item.name for item in fields(kind)}
    records = []
    try:
        for number, item in enumerate(document.get(name, [])):
            values = {key: value for key, value in item.items() if key in known}
            _check(values, f"{path}: {name}[{number}]")
            records.append(kind(**values))
    except (AttributeError, TypeError):
        raise DataError(
            f"{path}: {name} are not as gsfw writes them.", "Move the file away to begin anew."
        ) from None
    return {record.key: record for record in records}


def _check(values: Mapping[str, Any], where: str) -> None:
    """Refuse values of the wrong type: the file may have been edited by hand."""
    wrong = [
        (name, values[name], said)
        for name, kind, said in TYPES
        if name in values and type(values[name]) is not kind
    ]
    if not wrong:
        wrong = [
            (f"figures.{name}", value, "a number")
            for name, value in values.get("figures", {}).items()
            if type(value) not in (int, float) or not math.isfinite(value)
        ]
    for name, value, said in wrong:
        raise DataError(
            f"{where}: {name} is {value!r}; expected {said}.",
            "Put it right, or move the file away to begin anew: runs that are finished are found "
            "again in their folders.",
        )
