"""Source files of the kernels, which are part of the package, and the constants in them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

SOURCES = Path(__file__).parent / "sources"
"""The CUDA kernels, one file per stage, and the headers that only they use."""

SHARED = Path(__file__).parents[1] / "shared"
"""Headers of the mathematics that the CPU kernels use too."""


@cache
def headers() -> Mapping[str, str]:
    """Every header, by the name under which it is included."""
    return {
        path.name: path.read_text(encoding="utf-8")
        for folder in (SHARED, SOURCES)
        for path in sorted(folder.glob("*.h"))
    }


@cache
def source_text(name: str) -> str:
    """The text of one file of kernels, such as "blend.cu"."""
    return (SOURCES / name).read_text(encoding="utf-8")


def constant(header: str, name: str) -> int:
    """The value of ``constexpr int NAME = VALUE;`` in a header, which is its only definition.

    Raises:
        ValueError: the header has no such line.
    """
    found = re.search(rf"constexpr int {name} = (\d+);", headers()[header])
    if found is None:
        raise ValueError(f"{header}: expected a line 'constexpr int {name} = NUMBER;'")
    return int(found[1])


def enumerators(header: str, name: str) -> Mapping[str, int]:
    """The numbers of an enumeration in a header, by enumerator.

    Raises:
        ValueError: the header has no such enumeration.
    """
    found = re.search(rf"enum (?:class )?{name}\b[^{{]*{{(.*?)}}", headers()[header], re.DOTALL)
    if found is None:
        raise ValueError(f"{header}: expected an enumeration {name}")
    numbers: dict[str, int] = {}
    for field in found[1].split(","):
        key, _, value = (part.strip() for part in field.partition("="))
        numbers[key] = int(value) if value else len(numbers)
    return numbers
