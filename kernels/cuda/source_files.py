"""Source files: the kernels' text, which is part of the package."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

SOURCES = Path(__file__).parent / "sources"
"""The kernels, one file per stage, and the headers that only they use."""

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
