"""JSON text that every reader takes: what is not a number is null."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any


def json_text(document: object, indent: int | None = None) -> str:
    """A document of plain data as JSON; NaN and infinities, which JSON does not have, as null."""
    return json.dumps(_readable(document), indent=indent, allow_nan=False)


def _readable(value: object) -> Any:  # noqa: ANN401 - plain data of any kind
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _readable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_readable(item) for item in value]
    return value
