"""Dependencies: settings that act only where another setting has a certain value.

A configuration class declares them for its own settings and groups, by dotted key:

    acts_with: ClassVar[Mapping[str, str]] = {"bands": "sh=adaptive", "start": "rounds>0"}

Conditions are ``key=value``, ``key!=value`` or ``key>number``; ``" or "`` joins alternatives. The
key "" means all settings of the class.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, fields, is_dataclass
from functools import reduce
from typing import Any

CONDITION = re.compile(r"(?P<key>[\w.]+)(?P<sign>!=|=|>)(?P<value>\S+)")
"""One alternative of a condition."""


@dataclass(frozen=True)
class Unmet:
    """A setting, or a group of settings, whose condition does not hold."""

    key: str
    """Dotted key of the setting or the group."""
    condition: str
    """The condition, with dotted keys of the whole configuration."""
    asked: tuple[str, ...]
    """Dotted keys that the condition asks for."""

    def covers(self, key: str) -> bool:
        """True for the setting, or one of the group that the condition does not ask for."""
        return (key == self.key or key.startswith(f"{self.key}.")) and key not in self.asked


def unmet_dependencies(config: object, prefix: str = "") -> list[Unmet]:
    """Dependencies of a configuration and its nested ones that do not hold.

    Args:
        config: a dataclass.
        prefix: prefix of its keys, such as "strategy.".

    Raises:
        ValueError, TypeError: a declaration is no condition, or compares what is no number.
        AttributeError: a declaration asks for a setting that does not exist.
    """
    declared: dict[str, str] = {}
    for kind in reversed(type(config).__mro__):
        declared |= vars(kind).get("acts_with", {})
    found = []
    for key, text in declared.items():
        matches = list(CONDITION.finditer(text))
        if " or ".join(match.group() for match in matches) != text:
            raise ValueError(f"{type(config).__name__}.acts_with: {text!r} is no condition")
        if not any(_holds(config, match) for match in matches):
            condition = " or ".join(prefix + match.group() for match in matches)
            asked = tuple(prefix + match["key"] for match in matches)
            found.append(Unmet((prefix + key).rstrip("."), condition, asked))
    for item in fields(config):  # type: ignore[arg-type]
        value = getattr(config, item.name)
        if is_dataclass(value):
            found += unmet_dependencies(value, f"{prefix}{item.name}.")
    return found


def _holds(config: object, condition: re.Match[str]) -> bool:
    """True if an alternative holds."""
    value: Any = reduce(getattr, condition["key"].split("."), config)
    sign, wanted = condition["sign"], condition["value"]
    if sign == ">":
        return float(value) > float(wanted)
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return (text == wanted) == (sign == "=")
