"""Names: the spellings of a new part's name, and the names that it cannot have."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.util import find_spec
from keyword import iskeyword

from gsfw.core.errors import ConfigError
from gsfw.plugins.registry import Registry, origin

MOST_LETTERS = 30
"""Length of a name that fits into lines of code and columns of lists."""

SHAPE = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
"""Names of distributions that are the same in every spelling of package tools."""

FOLDERS = frozenset({"build", "dist", "runs", "tests"})
"""Folders of a package that are not its module."""


@dataclass(frozen=True)
class PartName:
    """The spellings of a name: my-part, my_part and MyPart."""

    dashed: str
    """Name of the part, and of the distribution."""

    @property
    def module(self) -> str:
        """Name of the package that is imported; no module begins with a digit."""
        word = self.dashed.replace("-", "_")
        return f"gsfw_{word}" if word[0].isdigit() else word

    @property
    def camel(self) -> str:
        """First word of the names of classes."""
        return "".join(word.capitalize() for word in self.module.split("_"))


def check_name(text: str, slot: str, registry: Registry) -> PartName:
    """Check the name of a new part.

    Args:
        text: the name.
        slot: kind of the part.
        registry: the installed parts.

    Raises:
        ConfigError: it is no name of a package, or is taken; says by what.
    """
    if not SHAPE.fullmatch(text) or len(text) > MOST_LETTERS:
        better = re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:MOST_LETTERS].strip("-")
        raise ConfigError(
            f"gsfw new: {text!r} cannot be the name of a package.",
            f"Use at most {MOST_LETTERS} small letters and digits, in words with dashes between "
            f"them{f', such as {better}' if better else ''}.",
        )
    taken = registry.slot(slot).get(text)
    if taken is not None:
        raise ConfigError(
            f"gsfw new: there is a {slot} {text!r} already, of {origin(taken)}.",
            "Choose another name.",
        )
    name = PartName(text)
    if iskeyword(name.module) or iskeyword(name.camel):
        raise ConfigError(
            f"gsfw new: {text!r} is a keyword of Python.", f"Choose another name: my-{text}."
        )
    if name.module in FOLDERS or find_spec(name.module) is not None:
        raise ConfigError(
            f"gsfw new: a module {name.module!r} exists here already; two would hide each other.",
            f"Choose another name: my-{text}.",
        )
    return name
