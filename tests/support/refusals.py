"""Refusals: what a reader says of a file that it does not take."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from gsfw.core.errors import DataError


def refusal_of(read: Callable[[Path], object]) -> Callable[[Path], str]:
    """A function that reads a file, which must be refused, and returns cause and remedy.

    The path of the file is FILE in the text.
    """

    def refusal(path: Path) -> str:
        with pytest.raises(DataError) as caught:
            read(path)
        return str(caught.value).replace(str(path), "FILE")

    return refusal


def failure_of(build: Callable[..., object]) -> Callable[..., str]:
    """A function that builds a data set, which must be refused, and returns cause and remedy."""

    def failure(*given: object) -> str:
        with pytest.raises(DataError) as caught:
            build(*given)
        return str(caught.value)

    return failure
