"""Asked: the time that a run may take, or the quality at which it ends, as the user gave it."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from gsfw.core.config import AUTO
from gsfw.core.errors import ConfigError
from gsfw.plugins.settings import PLANNED_BY, Layer, Settings
from gsfw.plugins.values import as_text

DECIDED = ("steps", "pace", "held_back", "eval_every")
"""Keys that every plan decides; recorded ones are left out when the run is planned anew, and with
them the others that the file names as planned."""
BOUND = 30.0
"""Minutes after which a run with until= ends if it does not get there, unless minutes= is given."""
LENGTHS = ("steps", "preset", "pace", "rescale")
"""Keys that say how long a run is: the user, and not gsfw, then chooses the length."""
USUAL = 5.0
"""Minutes of a run on a data set of the user's own, if nothing says how long it is. On fox two idle
cores gain nothing more at 180 x 320 pixels from 82 s on, and 0.2 dB at 359 x 640 from 113 s on."""


@dataclass(frozen=True)
class Asked:
    """Conditions that a planned run has to keep."""

    minutes: float
    """From the start of the command to its end."""
    until: str = ""
    """PSNR in dB of training views that are held back, "auto", or empty for the time alone."""

    def __str__(self) -> str:
        """The settings: "minutes=5 until=31"."""
        until = f" until={self.until}" if self.until else ""
        return f"minutes={self.minutes:g}{until}"


def spelled_out(layers: Sequence[Layer]) -> list[Layer]:
    """The layers with ``until=auto`` in the place of ``steps=auto``.

    Raises:
        ConfigError: one layer has both minutes and steps, which contradict each other.
    """
    found = [_with_until(layer) for layer in layers]
    for layer in found:
        if "steps" in layer.values and "minutes" in layer.values and layer.gives("minutes"):
            minutes, steps = (as_text(layer.values[key]) for key in ("minutes", "steps"))
            raise ConfigError(
                f"minutes={minutes} and steps={steps}: a run ends after a time or after a number "
                "of steps.",
                f"Leave out steps={steps}: it is planned so that the time is kept.",
            )
    last_time = max(_last(found, key) for key in PLANNED_BY)
    if last_time > _last(found, "steps"):  # The user plans a recorded run anew.
        found[:last_time] = [
            without(layer, layer.planned or DECIDED) for layer in found[:last_time]
        ]
    return found


def asked_of(settings: Settings, layers: Sequence[Layer]) -> Asked | None:
    """The user's conditions; ``None`` for a run of a number of steps.

    A run on data of the user's own has a usual time, unless something says how long it is.

    Raises:
        ConfigError: a time or a PSNR makes no sense, or schedules may not follow the plan.
    """
    config = settings.config
    given = {key for layer in layers for key in layer.values if layer.gives(key)}
    if "minutes" in given and config.minutes <= 0:
        raise ConfigError(
            f"minutes={config.minutes:g}: expected more than 0 minutes.",
            "Give the time that you want to wait, such as minutes=5; steps=N has no limit of time.",
        )
    if config.until:
        _check_until(config.until)
    if config.processes:
        _check_unplanned(config.processes, given)
        return None
    if not given.intersection(PLANNED_BY) and config.data and not given.intersection(LENGTHS):
        return Asked(USUAL)
    if not given.intersection(PLANNED_BY) or config.pace or ("steps" in given and not config.until):
        return None
    if not config.rescale:
        raise ConfigError(
            "rescale=false keeps every schedule at its number of steps, and a run with "
            f"{'minutes' if config.minutes else 'until'}= plans that number.",
            "Leave out rescale=false, or give steps=N.",
        )
    return Asked(config.minutes or BOUND, config.until)


def _check_unplanned(processes: int, given: Collection[str]) -> None:
    """Refuse a time or a quality for several processes: their clocks differ."""
    for key in PLANNED_BY:
        if key in given:
            raise ConfigError(
                f"processes={processes} and {key}=: runs of several processes end after a number "
                "of steps.",
                f"Leave out {key}=, and give steps=N.",
            )


def _check_until(until: str) -> None:
    try:
        sound = until == AUTO or (math.isfinite(float(until)) and float(until) > 0)
    except ValueError:
        sound = False
    if not sound:
        raise ConfigError(
            f"until={until}: expected a PSNR in dB such as 31, or auto.",
            "It is measured on training views that the run holds back, not on the held-out views.",
        )


def _with_until(layer: Layer) -> Layer:
    if "steps" not in layer.values or as_text(layer.values["steps"]) != AUTO:
        return layer
    if "until" in layer.values:
        raise ConfigError(
            f"steps=auto and until={as_text(layer.values['until'])}: steps=auto means until=auto.",
            "Give one of them.",
        )
    return replace(
        without(layer, ("steps",)), values={**without(layer, ("steps",)).values, "until": AUTO}
    )


def without(layer: Layer, keys: Collection[str]) -> Layer:
    """The layer without some keys."""
    values = {key: value for key, value in layer.values.items() if key not in keys}
    given = None if layer.given is None else layer.given - frozenset(keys)
    return replace(layer, values=values, given=given, planned=layer.planned - frozenset(keys))


def _last(layers: Sequence[Layer], key: str) -> int:
    """Place of the last layer that gives a key; -1 if there is none."""
    return max((place for place, layer in enumerate(layers) if layer.gives(key)), default=-1)
