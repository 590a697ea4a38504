"""RecordStore: what is measured of a run's variants, kept in a file as soon as it is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from gsfw.core.errors import DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text, read_document
from gsfw.studies.tradeoff.record import Record

SCHEMA = 1
"""Number of the layout; raised when an older gsfw could not read a newer file."""

ADVICE = "Move it away to measure anew."
"""What to do with a file that is not one of these."""

Key = tuple[str, str]
Head = Callable[["RecordStore"], Mapping[str, Any]]
"""What a document says before its records."""


class RecordStore:
    """Records by axis and name; each change is on disk before it returns."""

    def __init__(self, path: Path, fingerprint: str, clock: str = "") -> None:
        """Read what is there; what was measured of another model, or in another way, is let go.

        Args:
            path: of the file.
            fingerprint: of all that accuracy depends on.
            clock: what times and memory depend on besides; those of other conditions are let go.

        Raises:
            DataError: the file is damaged, or was written by a newer gsfw.
        """
        self.path, self.fingerprint, self.clock = path, fingerprint, clock
        self.records: dict[Key, Record] = {}
        self.forgotten = 0
        """How many records were let go."""
        if path.exists():
            document = read_document(path, SCHEMA, ADVICE)
            records = _records(path, document)
            if document.get("fingerprint") == fingerprint:
                if document.get("clock") != clock:
                    records = [replace(r, readings=[], peak_memory_mb=None) for r in records]
                self.records = {record.key: record for record in records}
            else:
                self.forgotten = len(records)

    def keep(self, record: Record) -> None:
        """Add a record, or replace it.

        Raises:
            OutputError: the file cannot be written.
        """
        self.records[record.key] = record
        self.write({})

    def add_round(self, readings: Mapping[Key, float]) -> None:
        """Add the times of a round, in milliseconds.

        Raises:
            OutputError: the file cannot be written.
        """
        for key, reading in readings.items():
            known = self.records[key]
            self.records[key] = replace(known, readings=[*known.readings, reading])
        self.write({})

    def write(self, head: Mapping[str, Any]) -> None:
        """Write everything, whole or not at all.

        Args:
            head: what the document says besides; what is made of records.

        Raises:
            OutputError: the file cannot be written.
        """
        document = {
            "schema": SCHEMA,
            "fingerprint": self.fingerprint,
            "clock": self.clock,
            **head,
            "records": [record.document() for record in self.records.values()],
        }
        write_atomically(self.path, (json_text(document, indent=1) + "\n").encode())


def _records(path: Path, document: Mapping[str, Any]) -> list[Record]:
    known = {item.name for item in fields(Record)}
    try:
        return [
            Record(**{key: value for key, value in item.items() if key in known})
            for item in document["records"]
        ]
    except (AttributeError, KeyError, TypeError):
        raise DataError(
            f"{path}: its records are not as gsfw writes them.", "Move it away to measure anew."
        ) from None
