"""JSON text: written so that every reader accepts it, and parsed within bounds."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.files.reading import check_downloaded

DEEPEST = 100
"""Most lists and objects within each other that are read; files of gsfw and of known tools have
fewer than 20. What goes through a document by recursion need not fear a deeper one."""


def json_text(document: object, indent: int | None = None) -> str:
    """A document of plain data as JSON; NaN and infinities, which JSON lacks, become null.

    Bytes of file names that are no Unicode are written as escapes within the text: readers, such as
    ``parsed_json``, refuse half of a surrogate pair.
    """
    return json.dumps(_readable(document), indent=indent, allow_nan=False)


def parsed_json(text: str | bytes) -> Any:  # noqa: ANN401 - plain data of any kind
    """Plain data of JSON.

    Raises:
        ValueError: it is no JSON, is nested too deeply, or has text that is no Unicode.
    """
    if isinstance(text, bytes):
        text = text.decode(json.detect_encoding(text))
    try:
        document = json.loads(text.removeprefix("\ufeff"))
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if text.count("[") + text.count("{") > DEEPEST:
        _check_depth(document)
    if "\\u" in text:
        # Half of a pair, as in "\\ud800", is no text that can be written or be a file's name.
        json.dumps(document, ensure_ascii=False).encode()
    return document


def _check_depth(document: object) -> None:
    """Check the depth of a document, level by level.

    Raises:
        ValueError: it is nested too deeply.
    """
    level, depth = [document], 0
    while level:
        depth += 1
        if depth > DEEPEST:
            raise ValueError(f"it is nested more than {DEEPEST} levels deep")
        level = [
            item
            for node in level
            if isinstance(node, dict | list)
            for item in (node.values() if isinstance(node, dict) else node)
            if isinstance(item, dict | list)
        ]


def read_json(path: Path, advice: str = COPY_AGAIN) -> Any:  # noqa: ANN401
    """Plain data of a JSON file.

    Raises:
        DataError: it cannot be read, or is no JSON; with ``advice`` as the remedy.
    """
    try:
        return parsed_json(path.read_bytes())
    except (OSError, ValueError) as error:
        check_downloaded(path)
        raise DataError(f"{path} cannot be read as JSON: {error}.", advice) from error


def read_document(path: Path, schema: int, advice: str) -> Mapping[str, Any]:
    """Read an object from a JSON file with a known layout.

    Args:
        path: path of the file.
        schema: version of the layout, which the object's ``schema`` has to equal.
        advice: remedy for another content.

    Raises:
        DataError: it cannot be read, or has another content.
    """
    document = read_json(path, advice)
    if not isinstance(document, dict) or document.get("schema") != schema:
        found = document.get("schema") if isinstance(document, dict) else type(document).__name__
        raise DataError(f"{path}: expected schema {schema}, found {found}.", advice)
    return document


def _readable(value: object) -> Any:  # noqa: ANN401 - plain data of any kind
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {_readable(key): _readable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_readable(item) for item in value]
    if isinstance(value, str) and not value.isascii():
        return value.encode(errors="backslashreplace").decode()
    return value
