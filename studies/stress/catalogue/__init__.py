"""Catalogue: every case, by name.

One module for each section, or for several small ones. A name says its section, what is extreme,
and how it is drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatch
from types import MappingProxyType

from gsfw.core.errors import ConfigError
from gsfw.plugins.registry import did_you_mean
from gsfw.studies.stress.case import Change, StressCase
from gsfw.studies.stress.catalogue import (
    colour,
    depth,
    image,
    opacity,
    position,
    rotation,
    shape,
)
from gsfw.studies.stress.catalogue.camera import CAMERA
from gsfw.studies.stress.catalogue.colour import COLOUR
from gsfw.studies.stress.catalogue.depth import DEPTH
from gsfw.studies.stress.catalogue.found import FOUND
from gsfw.studies.stress.catalogue.image import IMAGE
from gsfw.studies.stress.catalogue.layers import LAYERS
from gsfw.studies.stress.catalogue.opacity import OPACITY
from gsfw.studies.stress.catalogue.position import POSITION
from gsfw.studies.stress.catalogue.precision import PRECISION
from gsfw.studies.stress.catalogue.refused import REFUSED
from gsfw.studies.stress.catalogue.rotation import ROTATION
from gsfw.studies.stress.catalogue.shape import SHAPE
from gsfw.studies.stress.catalogue.size import SIZE

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
"""What is drawn, by name; cases of time, which need a model, are in ``moving_case``."""

CHANGES: Mapping[str, Change] = MappingProxyType(
    {
        name: change
        for section in (shape, rotation, opacity, depth, position, image, colour)
        for name, change in section.CHANGES.items()
    }
)
"""What makes ordinary splats extreme, by the names of the cases without their variants."""


def chosen(names: Sequence[str], patterns: Sequence[str]) -> list[str]:
    """The names that match a pattern; all of them where there is none.

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
