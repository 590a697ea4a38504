"""Settings counted in training steps, which ``steps=N`` rescales."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from gsfw.core.ranges import number


def steps_field(default: int, *, at_least: int = 0, floor: int = 0) -> Any:  # noqa: ANN401 - a dataclass field
    """A setting counted in training steps, which ``steps=N`` rescales in proportion.

    Args:
        default: number of steps at the method's own default length.
        at_least: the smallest value that can be given.
        floor: least value after rescaling, for intervals in which statistics have to gather.
    """
    floor = max(floor, at_least)
    return number(default, at_least=at_least, metadata={"unit": "steps", "floor": floor})


@dataclass(frozen=True)
class Rescaled:
    """Number of steps in a preset that ``steps=N`` rescales like a default; plain numbers stay."""

    steps: int
    """Number of steps at the method's default length."""


def step_settings(config: object, prefix: str = "") -> dict[str, tuple[int, int]]:
    """Every setting counted in steps, by dotted key: its value and the lower bound of rescaling."""
    found: dict[str, tuple[int, int]] = {}
    for item in fields(config):  # type: ignore[arg-type]
        value = getattr(config, item.name)
        if item.metadata.get("unit") == "steps":
            found[prefix + item.name] = (value, item.metadata["floor"])
        elif is_dataclass(value):
            found |= step_settings(value, f"{prefix}{item.name}.")
    return found
