"""JSON text that every reader accepts: NaN and infinities become null."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsfw.core.errors import DataError


def json_text(document: object, indent: int | None = None) -> str:
    """A document of plain data as JSON; NaN and infinities, which JSON lacks, become null."""
    return json.dumps(_readable(document), indent=indent, allow_nan=False)


def read_document(path: Path, schema: int, advice: str) -> Mapping[str, Any]:
    """Read an object from a JSON file with a known layout.

    Args:
        path: path of the file.
        schema: version of the layout, which the object's ``schema`` has to equal.
        advice: remedy for another content.

    Raises:
        DataError: it cannot be read, or has another content.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DataError(f"{path} cannot be read: {error}.", advice) from None
    if not isinstance(document, dict) or document.get("schema") != schema:
        found = document.get("schema") if isinstance(document, dict) else type(document).__name__
        raise DataError(f"{path}: expected schema {schema}, found {found}.", advice)
    return document


def _readable(value: object) -> Any:  # noqa: ANN401 - plain data of any kind
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _readable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_readable(item) for item in value]
    return value
