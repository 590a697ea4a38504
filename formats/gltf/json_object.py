"""JsonObject: an object of a JSON file from anywhere, with a check of every value."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsfw.core.errors import COPY_AGAIN, DataError

MOST_JSON = 1 << 24
"""Bytes of a document: files of splats have a few thousand, large worlds of meshes some million."""
LARGEST = 2**53


@dataclass(frozen=True)
class JsonObject:
    """One object."""

    path: Path
    """Path of the file, for messages."""
    where: str
    """Path of the object in it: "meshes[0].primitives[1]"; empty for the document."""
    values: Mapping[str, Any]

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def refuse(self, name: str, expected: str) -> DataError:
        """The error for a value."""
        found = repr(self.values[name]) if name in self.values else "nothing"
        found = found if len(found) <= 60 else f"{found[:57]}..."
        place = f"{self.where}.{name}" if self.where else name
        return DataError(f"{self.path}: {place}: expected {expected}, found {found}.", COPY_AGAIN)

    def count(self, name: str, default: int | None = None) -> int:
        """A whole number of at least 0.

        Raises:
            DataError: it is another value, or there is none and no default.
        """
        value = self.values.get(name, default)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= LARGEST:
            raise self.refuse(name, "a whole number of at least 0")
        return value

    def text(self, name: str, default: str | None = None) -> str:
        """Text.

        Raises:
            DataError: it is another value, or there is none and no default.
        """
        value = self.values.get(name, default)
        if not isinstance(value, str):
            raise self.refuse(name, "text")
        return value

    def numbers(self, name: str, default: list[float]) -> list[float]:
        """As many finite numbers as the default has.

        Raises:
            DataError: it is another value.
        """
        value = self.values.get(name, default)
        right = isinstance(value, list) and len(value) == len(default)
        if not right or not all(_is_number(item) for item in value):
            raise self.refuse(name, f"{len(default)} numbers")
        return [float(item) for item in value]

    def fields(self, name: str) -> JsonObject:
        """An object; an empty one if there is none.

        Raises:
            DataError: it is another value.
        """
        value = self.values.get(name, {})
        if not isinstance(value, dict):
            raise self.refuse(name, "an object")
        return JsonObject(self.path, f"{self.where}.{name}" if self.where else name, value)

    def items(self, name: str) -> list[JsonObject]:
        """A list of objects; an empty one if there is none.

        Raises:
            DataError: it is another value.
        """
        value = self.values.get(name, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self.refuse(name, "a list of objects")
        place = f"{self.where}.{name}" if self.where else name
        return [
            JsonObject(self.path, f"{place}[{index}]", item) for index, item in enumerate(value)
        ]

    def indices(self, name: str, length: int) -> list[int]:
        """Numbers of items of a list with this length; none if there is no such value.

        Raises:
            DataError: it is another value.
        """
        value = self.values.get(name, [])
        if not isinstance(value, list) or not all(_is_index(item, length) for item in value):
            raise self.refuse(name, f"numbers from 0 to {length - 1}")
        return value

    def pick(self, name: str, items: list[JsonObject]) -> JsonObject:
        """The item of a list that a number names.

        Raises:
            DataError: it is another value, or the list has no such item.
        """
        index = self.count(name)
        if index >= len(items):
            raise self.refuse(name, f"a number below {len(items)}")
        return items[index]


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= LARGEST if isinstance(value, int) else math.isfinite(value)


def _is_index(value: object, length: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < length


def parsed(path: Path, text: bytes) -> JsonObject:
    """The object that a JSON text is.

    Raises:
        DataError: it is none, or too large, or nested too deeply.
    """
    if len(text) > MOST_JSON:
        raise DataError(
            f"{path}: its JSON has {len(text)} bytes, and {MOST_JSON} are read.",
            "Export the splats alone from the tool that made it.",
        )
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise DataError(f"{path} has damaged JSON: {reason}.", COPY_AGAIN) from None
    if not isinstance(values, dict):
        raise DataError(f"{path} has damaged JSON: it is no object.", COPY_AGAIN)
    return JsonObject(path, "", values)
