"""Axes: ways to make a run smaller or faster before training, and the runs that each fits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gsfw.core.config import AUTO

BASELINE = "baseline"
"""Name of the run without any choice."""

LIMITS = {name: "strategy.budget" for name in ("adc", "error", "mcmc")}
"""Strategies with a limit of Gaussians, and the setting of the limit."""

START = "random_points"
"""Setting: number of Gaussians at the start where the data has no points."""

PARTS = (2, 4, 8)
"""Divisors of the baseline's number of Gaussians."""

SHRINKS = (2, 4)
"""Factors by which training images are smaller than those of the evaluation."""

Values = Mapping[str, Any]
"""Every setting of the base, by dotted key."""


@dataclass(frozen=True)
class Choice:
    """One value on one axis."""

    axis: str
    name: str
    """Name in tables."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the run by dotted key."""
    part: float | None = None
    """Most Gaussians of the run as part of the baseline's; ``None`` for no limit."""


@dataclass(frozen=True)
class Recipe:
    """Choices on different axes; none for the baseline."""

    choices: tuple[Choice, ...] = ()

    @property
    def name(self) -> str:
        """Name in tables."""
        return " + ".join(choice.name for choice in self.choices) or BASELINE

    @property
    def part(self) -> float | None:
        """Most Gaussians as part of the baseline's; ``None`` for no limit."""
        return min((c.part for c in self.choices if c.part is not None), default=None)

    @property
    def settings(self) -> dict[str, Any]:
        """Changed settings, without the limit of Gaussians."""
        return {key: value for choice in self.choices for key, value in choice.settings.items()}


@dataclass(frozen=True)
class Axis:
    """One way to make a run smaller or faster."""

    name: str
    choices: Callable[[Values], Sequence[Choice]]
    """Gives its choices for a base; none where they would change nothing or make no sense."""
    why_not: str
    """Reason where there are no choices."""


def _sh_degrees(base: Values) -> list[Choice]:
    return [
        Choice("sh_degree", f"sh_degree={degree}", {"sh_degree": degree})
        for degree in reversed(range(min(3, int(base.get("sh_degree", 0)))))
    ]


def _adaptive_sh(base: Values) -> list[Choice]:
    if base.get("sh", "adaptive") == "adaptive":
        return []
    return [Choice("sh", "sh=adaptive", {"sh": "adaptive"})]


def _caps(base: Values) -> list[Choice]:
    found = []
    if limit_key(base):
        found = [Choice("cap", f"cap 1/{part}", part=1 / part) for part in PARTS]
    grows = base.get("strategy") != "none"
    if grows and base.get("strategy.budget", "auto") != "auto":
        found.append(Choice("cap", "budget=auto", {"strategy.budget": "auto"}))
    return found


def _resolutions(base: Values) -> list[Choice]:
    return [
        Choice("resolution", f"resolution 1/{factor}", {"downscale": base["downscale"] * factor})
        for factor in SHRINKS
    ]


def _strategies(base: Values) -> list[Choice]:
    # MCMC fills its limit whatever the scene, so that only equal numbers can be compared.
    return [
        Choice("strategy", f"strategy={name}", {"strategy": name}, part=1.0)
        for name in LIMITS
        if base["strategy"] in LIMITS and name != base["strategy"]
    ]


def _antialias(base: Values) -> list[Choice]:
    other = not base["antialias"]
    return [Choice("antialias", f"antialias={str(other).lower()}", {"antialias": other})]


AXES = (
    Axis("sh_degree", _sh_degrees, "the colours are the same from everywhere already"),
    Axis("sh", _adaptive_sh, "sh=adaptive is no choice here"),
    Axis("cap", _caps, "the strategy has no limit of Gaussians"),
    Axis("resolution", _resolutions, ""),
    Axis("strategy", _strategies, f"it is between {', '.join(LIMITS)}"),
    Axis("antialias", _antialias, ""),
)
"""All axes but the length of training, which is in steps."""

STEPS = "steps"
NAMES = (*(axis.name for axis in AXES), STEPS)
DEFAULT = ("sh_degree", "cap", STEPS, "resolution")
"""Default axes."""


def limit_key(values: Values) -> str:
    """Setting that limits the Gaussians of a base's strategy; empty for none."""
    key = LIMITS.get(str(values["strategy"]), "")
    return key if key in values else ""


def limited(values: Values, strategy: str, gaussians: int) -> dict[str, Any]:
    """Settings that limit the Gaussians of a run, and its random Gaussians at the start.

    Args:
        values: every setting of the base.
        strategy: of the run.
        gaussians: at least 1.
    """
    found: dict[str, Any] = {LIMITS[strategy]: str(gaussians)}
    start = values.get(START, AUTO)
    if start != AUTO and start > gaussians:
        found[START] = gaussians
    return found
