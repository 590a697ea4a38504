"""Plan: what was chosen for a search, kept in a file so that the same command goes on with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gsfw.core.errors import DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text, read_document
from gsfw.studies.planned_run import fingerprint
from gsfw.studies.tradeoff.training.sizing import Sizing

SCHEMA = 1
"""Number of the layout; raised when an older gsfw could not read a newer file."""

ADVICE = "Move it away to choose anew."
"""What to do with a file that is not one of these."""


def read_plan(path: Path, request: Mapping[str, Any]) -> Sizing | None:
    """What was chosen for the same request; ``None`` for none.

    Raises:
        DataError: the file is damaged, or was written by a newer gsfw.
    """
    if not path.exists():
        return None
    document = read_document(path, SCHEMA, ADVICE)
    if document.get("request") != fingerprint(request):
        return None
    try:
        return Sizing(**document["sizing"])
    except (KeyError, TypeError):
        raise DataError(f"{path}: it is not as gsfw writes it.", ADVICE) from None


def write_plan(path: Path, request: Mapping[str, Any], sizing: Sizing) -> None:
    """Keep what was chosen for a request.

    Raises:
        OutputError: the file cannot be written.
    """
    document = {"schema": SCHEMA, "request": fingerprint(request), "sizing": asdict(sizing)}
    write_atomically(path, (json_text(document, indent=1) + "\n").encode())
