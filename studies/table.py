"""Table: headings and rows of text, for a terminal, for Markdown and for CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple


class Table(NamedTuple):
    """Text in columns; ``Console.table(*table)`` prints it."""

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    title: str = ""
    """A line above the table; empty for none."""

    def markdown(self) -> str:
        """The table in Markdown: the first column aligned left, all others right."""
        marks = ["---", *("---:" for _ in self.headings[1:])]
        lines = (self.headings, marks, *self.rows)
        escaped = ([cell.replace("|", r"\|") for cell in line] for line in lines)
        return "\n".join(f"| {' | '.join(line)} |" for line in escaped)

    def csv(self) -> str:
        """The table as comma-separated values, with a line for the headings."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(self.headings)
        writer.writerows(self.rows)
        return buffer.getvalue()


def table_of_records(records: Sequence[Mapping[str, Any]]) -> Table:
    """A row for each record and a column for each key that any of them has.

    Numbers keep all digits. ``None`` and missing keys are empty cells. Lists become words, and
    mappings become KEY=VALUE words.
    """
    names = list(dict.fromkeys(name for record in records for name in record))
    return Table(names, [[cell_text(record.get(name)) for name in names] for record in records])


def cell_text(value: object) -> str:
    """A value of plain data in one cell."""
    if value is None:
        return ""
    if isinstance(value, Mapping):
        return " ".join(f"{key}={item}" for key, item in value.items())
    return " ".join(map(str, value)) if isinstance(value, list | tuple) else str(value)
