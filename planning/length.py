"""Length: a number of steps of which the sampler of a run can make a schedule."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from gsfw.core.config import SamplerConfig
from gsfw.core.datamanager import Views
from gsfw.core.errors import ConfigError
from gsfw.core.loop.pace import UNIT, Decision
from gsfw.plugins.settings import Settings

FACTORS = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0, 64.0)
"""Factors by which a schedule is made longer than the updates of a run; the smallest that is enough
is taken."""
COUNTED = ("steps", "eval_every")
"""Decisions in steps of the schedule, which grow with it."""


def enough_steps(
    decided: Mapping[str, Any], settings_of: Callable[[Mapping[str, Any]], Settings], views: Views
) -> dict[str, Any]:
    """The decisions, with more steps if the sampler needs them: many times in a short run.

    The run then walks through its schedule at a higher pace from its first update on, and trains on
    some of the times.

    Args:
        decided: decisions by dotted key.
        settings_of: resolves the settings of a run with other decisions.
        views: the training views.
    """
    if "steps" not in decided:
        return dict(decided)
    for factor in FACTORS:
        longer = _longer(decided, factor)
        if _fits(settings_of(longer), views):
            return longer
    return dict(decided)


def _longer(decided: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """The decisions for a schedule longer by ``factor``, with the same number of updates."""
    more = {key: math.ceil(factor * decided[key]) for key in COUNTED if key in decided}
    pace = {} if factor == 1 else {"pace": [str(Decision(0, round(factor * UNIT)))]}
    return {**decided, **more, **pace}


def _fits(settings: Settings, views: Views) -> bool:
    """True if the sampler can be built."""
    config = settings.config
    assert isinstance(config.sampler, SamplerConfig)
    try:
        config.sampler.build(views, config.seed, config.steps)
    except ConfigError:
        return False
    return True
