"""Catalogue: all cases by name: section, extreme property and variant of rendering."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatch
from types import MappingProxyType

from gsfw.core.errors import ConfigError
from gsfw.plugins.registry import did_you_mean
from gsfw.studies.stress.case import Change, StressCase
from gsfw.studies.stress.catalogue.limits import FOUND, LAYERS, PRECISION, SIZE
from gsfw.studies.stress.catalogue.refused import REFUSED
from gsfw.studies.stress.catalogue.splats import (
    COLOUR,
    COLOUR_CHANGES,
    OPACITY,
    OPACITY_CHANGES,
    ROTATION,
    ROTATION_CHANGES,
    SHAPE,
    SHAPE_CHANGES,
)
from gsfw.studies.stress.catalogue.views import (
    CAMERA,
    DEPTH,
    DEPTH_CHANGES,
    IMAGE,
    IMAGE_CHANGES,
    POSITION,
    POSITION_CHANGES,
)

CASES: Mapping[str, StressCase] = MappingProxyType(
    {
        case.name: case
        for section in (
            *(SHAPE, ROTATION, OPACITY, DEPTH, POSITION, CAMERA, IMAGE),
            *(LAYERS, COLOUR, REFUSED, SIZE, PRECISION, FOUND),
        )
        for case in section
    }
)
"""Cases for rasterizers; cases of time, which need a model, are in ``moving_case``."""

CHANGES: Mapping[str, Change] = MappingProxyType(
    {
        name: change
        for changes in (
            *(SHAPE_CHANGES, ROTATION_CHANGES, OPACITY_CHANGES, DEPTH_CHANGES),
            *(POSITION_CHANGES, IMAGE_CHANGES, COLOUR_CHANGES),
        )
        for name, change in changes.items()
    }
)
"""Changes that make ordinary splats extreme, by the names of cases without the variant."""


def chosen(names: Sequence[str], patterns: Sequence[str]) -> list[str]:
    """The names that match a pattern; all names where no pattern is given.

    Args:
        names: to choose from.
        patterns: names, beginnings of names (``shape``), or patterns (``*/fisheye``).

    Raises:
        ConfigError: a pattern matches nothing; suggests the nearest name.
    """
    for pattern in patterns:
        if not any(_matches(name, pattern) for name in names):
            raise ConfigError(
                f"only={pattern}: no case has this name.{did_you_mean(pattern, names)}",
                "List them with gsfw stress list=true.",
            )
    return [name for name in names if not patterns or any(_matches(name, p) for p in patterns)]


def _matches(name: str, pattern: str) -> bool:
    return fnmatch(name, pattern) or name.startswith(f"{pattern}/")
