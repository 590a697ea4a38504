"""JSON files: read with their errors said in words, and looked into without trusting them."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.core.files.json_text import parsed_json


def read_json(path: Path) -> Any:  # noqa: ANN401 - whatever the file holds
    """The content of a file.

    Raises:
        DataError: it is not JSON.
    """
    try:
        return parsed_json(path.read_text("utf-8-sig"))
    except (OSError, ValueError) as error:
        raise DataError(
            f"{path} cannot be read as JSON: {error}",
            "Write or copy the file again; it may be missing or cut off.",
        ) from error


def read_object(path: Path) -> Mapping[str, Any]:
    """The content of a file that holds an object.

    Raises:
        DataError: it is not JSON, or something else.
    """
    return mapping(read_json(path), str(path))


def mapping(value: Any, where: str) -> Mapping[str, Any]:  # noqa: ANN401
    """A value that is an object.

    Raises:
        DataError: it is something else; begins with ``where``.
    """
    if not isinstance(value, dict):
        raise DataError(f"{where}: expected an object, found {_shown(value)}.")
    return value


def number(entry: Mapping[str, Any], key: str, where: str, default: float | None = None) -> float:
    """A setting that is a number.

    Raises:
        DataError: it is something else, or not there and has no default; begins with ``where``.
    """
    value = entry.get(key, default)
    # Numbers are written as such; true is one to Python, not to us.
    if isinstance(value, int | float) and not isinstance(value, bool):
        with contextlib.suppress(OverflowError):  # JSON has whole numbers of any length.
            if math.isfinite(found := float(value)):
                return found
    raise DataError(f"{where}: {key} is {_shown(value)}; expected a number.")


def optional_number(entry: Mapping[str, Any], key: str, where: str) -> float | None:
    """A setting that is a number; ``None`` where it is absent or null.

    Raises:
        DataError: it is something else; begins with ``where``.
    """
    return None if entry.get(key) is None else number(entry, key, where)


def numbers(value: Any, count: int, where: str) -> Float64[Tensor, " n"]:  # noqa: ANN401
    """So many numbers, in a list or in a list of lists.

    Raises:
        DataError: they are something else; begins with ``where``.
    """
    try:
        found = torch.tensor(value, dtype=torch.float64).flatten()
    except (TypeError, ValueError, RuntimeError, OverflowError):
        found = torch.empty(0, dtype=torch.float64)
    if len(found) != count or not found.isfinite().all():
        raise DataError(f"{where}: expected {count} numbers, found {_shown(value)}.")
    return found


def _shown(value: Any) -> str:  # noqa: ANN401
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."
