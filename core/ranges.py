"""Ranges: bounds of a setting, declared where its field is, and checked for all settings at once.

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
"""Types that the bounds of a whole number and of a real one have."""

RANGE = "range"
"""Key under which the metadata of a field hold its bounds."""


@dataclass(frozen=True)
class Range:
    """Bounds of a number; ``None`` where there is none."""

    at_least: Number | None = None
    above: Number | None = None
    at_most: Number | None = None
    below: Number | None = None

    def __contains__(self, value: Number) -> bool:
        """Whether a number is within all bounds; NaN never is."""
        return (
            (self.at_least is None or value >= self.at_least)
            and (self.above is None or value > self.above)
            and (self.at_most is None or value <= self.at_most)
            and (self.below is None or value < self.below)
            and not math.isnan(value)
        )

    def __str__(self) -> str:
        """The numbers within, as a phrase: "a number from 0 to 1"."""
        finite = self.below == math.inf
        below = None if finite else self.below
        noun = "a finite number" if finite else "a number"
        if self.at_least is not None and self.at_most is not None:
            return f"{noun} from {_shown(self.at_least)} to {_shown(self.at_most)}"
        if self.above is not None and below is not None:
            return f"{noun} between {_shown(self.above)} and {_shown(below)}"
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
    """A setting that is a number within bounds.

    Args:
        default: its value; whole for fields of type ``int``.
        at_least: the smallest value.
        above: values are larger than this.
        at_most: the largest value.
        below: values are smaller than this; ``math.inf`` for any finite number.
        metadata: what else is known of the field.
    """
    bounds = Range(at_least, above, at_most, below)
    return field(default=default, metadata={**(metadata or {}), RANGE: bounds})


def check_ranges(config: object, prefix: str = "") -> None:
    """Check every number of a configuration that has bounds, those of nested ones included.

    Settings that are ``None`` have no value to check.

    Args:
        config: a dataclass.
        prefix: of its keys, such as "sampler.".

    Raises:
        ConfigError: naming the first key out of range, its value, and what was expected.
    """
    for item in fields(config):  # type: ignore[arg-type]
        value, bounds = getattr(config, item.name), item.metadata.get(RANGE)
        if is_dataclass(value):
            check_ranges(value, f"{prefix}{item.name}.")
        elif bounds is not None and value is not None and value not in bounds:
            raise ConfigError(f"{prefix}{item.name}={_shown(value)}: expected {bounds}.")
