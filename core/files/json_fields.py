"""JsonFields: an object of untrusted JSON, with a check of every value."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from gsfw.core.errors import DataError
from gsfw.core.files.json_text import read_json

LARGEST_COUNT = 2**53
"""Largest count that is read; every reader of JSON keeps it whole."""
LONGEST = 60
"""Characters of a wrong value in a message."""
CORRECT = "Correct the value, or export the file again."
"""Next action after a wrong value in a file of another program."""


@dataclass(frozen=True)
class JsonFields:
    """One object of a document. Each value has to be there, unless its reader gives a default.

    All readers raise a ``DataError`` for a missing or another value: the place, what was expected
    and what was found.
    """

    path: Path
    """Path of the file, for messages."""
    where: str
    """Place of the object: "scene", "cameras[3]"; empty for the document itself."""
    values: Mapping[str, Any]
    remedy: str = "It was not written by gsfw, or was changed since; export the model again."
    """The next action after a wrong value, for messages."""
    document: str = "header"
    """The part of the file that holds the object, for messages; empty for all of it."""

    @staticmethod
    def read(path: Path) -> JsonFields:
        """The object that a file of another program holds.

        Raises:
            DataError: it cannot be read as JSON, or holds something else.
        """
        return JsonFields.of(read_json(path), path)

    @staticmethod
    def of(value: object, path: Path, where: str = "") -> JsonFields:
        """A value in a file of another program as an object.

        Raises:
            DataError: it is something else.
        """
        found = JsonFields(path, where, value if isinstance(value, dict) else {}, CORRECT, "")
        if not isinstance(value, dict):
            raise DataError(f"{found.at}: expected an object, found {_shown(value)}.", CORRECT)
        return found

    @property
    def at(self) -> str:
        """The file and the place of the object, for messages."""
        return f"{self.path}: {self.where}" if self.where else str(self.path)

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def refuse(self, name: str, expected: str) -> DataError:
        """The error for a value, or for its absence."""
        part = f" of its {self.document}" if self.document else ""
        place = f"{self.path}: {self._place(name)}{part}"
        if name not in self.values:
            return DataError(f"{place} is missing; expected {expected}.", self.remedy)
        found = _shown(self.values[name])
        return DataError(f"{place}: expected {expected}, found {found}.", self.remedy)

    def _place(self, name: str) -> str:
        between = "." if self.document else ": "
        return f"{self.where}{between}{name}" if self.where else name

    def text(self, name: str, default: str | None = None) -> str:
        """Text, which may be empty."""
        value = self.values.get(name, default)
        if not isinstance(value, str):
            raise self.refuse(name, "text")
        return value

    def flag(self, name: str, default: bool | None = None) -> bool:
        """True or false."""
        value = self.values.get(name, default)
        if not isinstance(value, bool):
            raise self.refuse(name, "true or false")
        return value

    def count(self, name: str, least: int = 0, default: int | None = None) -> int:
        """A whole number of at least ``least``."""
        value = self.values.get(name, default)
        if not _is_whole(value) or not least <= value <= LARGEST_COUNT:
            raise self.refuse(name, f"a whole number of at least {least}")
        return int(value)

    def number(
        self,
        name: str,
        default: float | None = None,
        low: float = -math.inf,
        high: float = math.inf,
    ) -> float:
        """A finite number from ``low`` to ``high``."""
        value = float(self.numbers(name, default=default))
        if not low <= value <= high:
            raise self.refuse(name, f"a number from {low:g} to {high:g}")
        return value

    def optional_number(
        self, name: str, low: float = -math.inf, high: float = math.inf
    ) -> float | None:
        """A number as ``number`` reads it; ``None`` if it is absent or null."""
        return None if self.values.get(name) is None else self.number(name, None, low, high)

    def positive(self, name: str) -> float:
        """A finite number above 0."""
        value = self.values.get(name)
        if not _is_number(value) or value <= 0:
            raise self.refuse(name, "a number above 0")
        return float(value)

    def numbers(
        self, name: str, *shape: int, default: float | Sequence[float] | None = None
    ) -> np.ndarray:
        """Finite numbers of this shape in nested lists, float64; -1 for any length.

        The result is one number per element: never a broadcast, never parsed text.
        """
        return self.numbers_of(name, (shape,), default)

    def numbers_of(
        self,
        name: str,
        shapes: Sequence[tuple[int, ...]],
        default: float | Sequence[float] | None = None,
    ) -> np.ndarray:
        """Finite numbers of one of these shapes, as ``numbers`` reads those of one."""
        value = self.values.get(name, default)
        wrong = [_wrong_part(value, shape) for shape in shapes]
        paths = [path for path in wrong if path is not None]
        if len(paths) < len(wrong):
            return np.array(value, dtype=np.float64)
        # The shape that fits furthest is the one that was meant.
        indices = max(paths, key=len)
        if not indices:
            raise self.refuse(name, _numbers_of(shapes))
        for index in indices:
            name, value = f"{name}[{index}]", value[index]
        rest = shapes[paths.index(indices)][len(indices) :]
        raise replace(self, values={name: value}).refuse(name, _numbers_of((rest,)))

    def first(self, *names: str) -> str:
        """The first of some names that there is; all of them, for a message, if there is none."""
        return next((name for name in names if name in self), " or ".join(names))

    def is_null(self, name: str) -> bool:
        """True if there is no value under this name."""
        if name not in self.values:
            raise self.refuse(name, "a value, or null")
        return self.values[name] is None

    def texts(self, name: str, default: list[str] | None = None) -> list[str]:
        """A list of texts."""
        value = self.values.get(name, default)
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self.refuse(name, "a list of texts")
        return value

    def fields(self, name: str, default: Mapping[str, Any] | None = None) -> JsonFields:
        """An object."""
        value = self.values.get(name, default)
        if not isinstance(value, dict):
            raise self.refuse(name, "an object")
        return replace(self, where=self._place(name), values=value)

    def objects(self, name: str, default: list[Any] | None = None) -> list[JsonFields]:
        """A list of objects."""
        value = self.values.get(name, default)
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self.refuse(name, "a list of objects")
        return [
            replace(self, where=f"{self._place(name)}[{index}]", values=item)
            for index, item in enumerate(value)
        ]

    def indices(self, name: str, length: int, default: list[int] | None = None) -> list[int]:
        """Numbers of items of a list with this length."""
        value = self.values.get(name, default)
        is_list = isinstance(value, list)
        if not is_list or not all(_is_whole(item) and 0 <= item < length for item in value):
            raise self.refuse(name, f"numbers from 0 to {length - 1}")
        return list(value)

    def pick(self, name: str, items: Sequence[JsonFields]) -> JsonFields:
        """The item of a list that a number names."""
        index = self.count(name)
        if index >= len(items):
            raise self.refuse(name, f"a number below {len(items)}")
        return items[index]


BROKEN = JsonFields.remedy


def _shown(value: object) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def _numbers_of(shapes: Sequence[tuple[int, ...]]) -> str:
    """Numbers of one of these shapes, in words."""
    sides = [
        " x ".join("any" if length < 0 else str(length) for length in shape) for shape in shapes
    ]
    return f"{' or '.join(sides)} finite numbers" if any(sides) else "one finite number"


def _is_whole(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_number(value: object) -> TypeGuard[float]:
    """True for a number that a float holds: neither NaN nor infinite, of any kind but bool."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    return abs(value) <= sys.float_info.max


def _wrong_part(value: object, shape: tuple[int, ...]) -> list[int] | None:
    """Indices of the first item that is no such list or number; ``None`` if there is none."""
    if not shape:
        return None if _is_number(value) else []
    if not isinstance(value, list) or shape[0] not in (-1, len(value)):
        return []
    for index, item in enumerate(value):
        wrong = _wrong_part(item, shape[1:])
        if wrong is not None:
            return [index, *wrong]
    return None
