"""Axes: what a run can give up before it is trained, and for which runs each makes sense."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gsfw.studies.tradeoff.training.choice import Choice

LIMITS = {"adc": "strategy.budget", "mcmc": "strategy.budget"}
"""Strategies that can be told how many Gaussians to end with, and the setting that says so."""

START = "random_points"
"""How many Gaussians a run starts with where its data has no points."""

PARTS = (2, 4, 8)
"""The baseline's Gaussians are divided by these."""

SHRINKS = (2, 4)
"""Training pictures are smaller by these factors than those that are judged."""

Values = Mapping[str, Any]
"""Every setting of the base, by dotted key."""


@dataclass(frozen=True)
class Axis:
    """One thing that can be given up."""

    name: str
    choices: Callable[[Values], Sequence[Choice]]
    """Its values for a base; none where they would change nothing or make no sense."""
    why_not: str
    """What to say where there are none."""


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
    if base.get("strategy.budget", "auto") != "auto":
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
    Axis("strategy", _strategies, f"it is between {' and '.join(LIMITS)}"),
    Axis("antialias", _antialias, ""),
)
"""All but the length of training, which is in steps and halves by itself."""

STEPS = "steps"
NAMES = (*(axis.name for axis in AXES), STEPS)
DEFAULT = ("sh_degree", "cap", STEPS, "resolution")
"""Axes that are tried where none are named."""


def limit_key(values: Values) -> str:
    """The setting that limits the Gaussians of a base's strategy; empty where there is none."""
    key = LIMITS.get(str(values["strategy"]), "")
    return key if key in values else ""


def limited(values: Values, strategy: str, gaussians: int) -> dict[str, Any]:
    """Settings that limit a run to so many Gaussians; at random, it starts with no more.

    Args:
        values: every setting of the base.
        strategy: of the run.
        gaussians: at least 1.
    """
    found: dict[str, Any] = {LIMITS[strategy]: str(gaussians)}
    if values.get(START, 0) > gaussians:
        found[START] = gaussians
    return found
