"""Names in a folder of ``gsfw prepare``, by which others recognise it."""

from __future__ import annotations

from pathlib import Path

from gsfw.core.files.reading import is_file

REPORT = "prepare.json"
"""The report for programs; written last."""
JOURNAL = "work/stages.json"
"""The finished stages; written from the first stage on."""


def is_begun(folder: Path) -> bool:
    """True if a preparation has begun in the folder, or ended."""
    # A folder that may not be searched is told of when it is listed.
    return any(is_file(folder / name) for name in (REPORT, JOURNAL))
