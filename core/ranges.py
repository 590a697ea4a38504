"""Ranges: bounds of a setting, declared at its field, and checked for all settings at once.

    share: float = number(0.1, above=0, at_most=1)

``check_ranges(config)`` then refuses ``strategy.share=2``, wherever the value came from.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

from gsfw.core.errors import ConfigError

Number = int | float
"""Types of the bounds of whole and of real numbers."""

RANGE = "range"
"""Key of the bounds in the metadata of a field."""


@dataclass(frozen=True)
class Range:
    """Bounds of a number; ``None`` for an open side."""

    at_least: Number | None = None
    above: Number | None = None
    at_most: Number | None = None
    below: Number | None = None

    def __contains__(self, value: Number) -> bool:
        """True if a number is within all bounds; false for NaN."""
        return (
            (self.at_least is None or value >= self.at_least)
            and (self.above is None or value > self.above)
            and (self.at_most is None or value <= self.at_most)
            and (self.below is None or value < self.below)
            and not math.isnan(value)
        )

    def __str__(self) -> str:
        """The range as a phrase: "a number from 0 to 1"."""
        finite = self.below == math.inf
        below = None if finite else self.below
        noun = "a finite number" if finite else "a number"
        if self.at_least is not None and self.at_most is not None:
            return f"{noun} from {_shown(self.at_least)} to {_shown(self.at_most)}"
        bounds = {
            "of at least": self.at_least,
            "above": self.above,
            "of at most" if self.at_least is self.above is None else "at most": self.at_most,
            "below": below,
        }
        phrases = [
            f"{words} {_shown(bound)}" for words, bound in bounds.items() if bound is not None
        ]
        return " ".join([noun, " and ".join(phrases)]).strip()


def _shown(value: Number) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def number(
    default: Number,
    *,
    at_least: Number | None = None,
    above: Number | None = None,
    at_most: Number | None = None,
    below: Number | None = None,
    metadata: Mapping[str, Any] | None = None,
) -> Any:  # noqa: ANN401 - a dataclass field
    """A setting with a numeric range.

    Args:
        default: default value; whole for fields of type ``int``.
        at_least: inclusive lower bound.
        above: exclusive lower bound.
        at_most: inclusive upper bound.
        below: exclusive upper bound; ``math.inf`` for any finite number.
        metadata: further metadata of the field.
    """
    bounds = Range(at_least, above, at_most, below)
    return field(default=default, metadata={**(metadata or {}), RANGE: bounds})


def check_ranges(config: object, prefix: str = "") -> None:
    """Check every number with bounds in a configuration and its nested configurations.

    Settings that are ``None`` have no value to check.

    Args:
        config: a dataclass.
        prefix: prefix of its keys, such as "sampler.".

    Raises:
        ConfigError: a number is out of range; names the first key, its value and its range.
    """
    for item in fields(config):  # type: ignore[arg-type]
        value, bounds = getattr(config, item.name), item.metadata.get(RANGE)
        if is_dataclass(value):
            check_ranges(value, f"{prefix}{item.name}.")
        elif bounds is not None and value is not None and value not in bounds:
            raise ConfigError(f"{prefix}{item.name}={_shown(value)}: expected {bounds}.")
