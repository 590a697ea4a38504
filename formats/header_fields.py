"""HeaderFields: untrusted plain data, with a check of every value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gsfw.core.errors import DataError

LARGEST_COUNT = 2**53
"""Largest whole number that every reader of JSON keeps whole."""


@dataclass(frozen=True)
class HeaderFields:
    """One object of a header."""

    path: Path
    """Path of the file, for messages."""
    where: str
    """Path of the object: "scene", "cameras[3]"; empty for the header itself."""
    values: Mapping[str, Any]
    remedy: str = "It was not written by gsfw, or was changed since; export the model again."
    """The next action after a wrong value, for messages."""

    def _find(self, name: str) -> Any:  # noqa: ANN401 - plain data of any kind
        if name not in self.values:
            raise DataError(f"{self.path}: its header has no {self._place(name)}.", self.remedy)
        return self.values[name]

    def _place(self, name: str) -> str:
        return f"{self.where}.{name}" if self.where else name

    def _refuse(self, name: str, expected: str) -> DataError:
        found = repr(self.values[name])
        found = found if len(found) <= 60 else f"{found[:57]}..."
        return DataError(
            f"{self.path}: {self._place(name)} of its header: expected {expected}, found {found}.",
            self.remedy,
        )

    def text(self, name: str) -> str:
        """Text, which may be empty."""
        value = self._find(name)
        if not isinstance(value, str):
            raise self._refuse(name, "text")
        return value

    def flag(self, name: str) -> bool:
        """True or false."""
        value = self._find(name)
        if not isinstance(value, bool):
            raise self._refuse(name, "true or false")
        return value

    def count(self, name: str, least: int = 0) -> int:
        """A whole number of at least ``least``."""
        value = self._find(name)
        whole = isinstance(value, int) and not isinstance(value, bool)
        if not whole or not least <= value <= LARGEST_COUNT:
            raise self._refuse(name, f"a whole number of at least {least}")
        return int(value)

    def positive(self, name: str) -> float:
        """A finite number above 0."""
        value = self._find(name)
        if not _is_number(value) or not 0 < value < math.inf:
            raise self._refuse(name, "a number above 0")
        return float(value)

    def numbers(self, name: str, *shape: int) -> np.ndarray:
        """Finite numbers of this shape in nested lists, float64; -1 for any length.

        The result is one number per element: never a broadcast, never parsed text.
        """
        sides = " x ".join("any" if length < 0 else str(length) for length in shape)
        expected = f"{sides} finite numbers" if shape else "one finite number"
        value = self._find(name)
        if not _has_shape(value, shape):
            raise self._refuse(name, expected)
        array = np.array(value, dtype=np.float64)
        if not np.isfinite(array).all():
            raise self._refuse(name, expected)
        return array

    def is_null(self, name: str) -> bool:
        """True if there is no value under this name."""
        return self._find(name) is None

    def texts(self, name: str) -> list[str]:
        """A list of texts."""
        value = self._find(name)
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise self._refuse(name, "a list of texts")
        return value

    def fields(self, name: str) -> HeaderFields:
        """An object."""
        value = self._find(name)
        if not isinstance(value, dict):
            raise self._refuse(name, "an object")
        return replace(self, where=self._place(name), values=value)

    def objects(self, name: str) -> list[HeaderFields]:
        """A list of objects."""
        value = self._find(name)
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self._refuse(name, "a list of objects")
        return [
            replace(self, where=f"{self._place(name)}[{index}]", values=item)
            for index, item in enumerate(value)
        ]


BROKEN = HeaderFields.remedy


def _is_number(value: object) -> bool:
    small = not isinstance(value, int) or abs(value) <= LARGEST_COUNT
    return isinstance(value, int | float) and not isinstance(value, bool) and small


def _has_shape(value: object, shape: tuple[int, ...]) -> bool:
    if not shape:
        return _is_number(value)
    if not isinstance(value, list) or shape[0] not in (-1, len(value)):
        return False
    return all(_has_shape(item, shape[1:]) for item in value)
