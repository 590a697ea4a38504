"""Sentences: missing and unneeded parts of a model, and settings to try."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gsfw.core.loop.requirements import LeastUseful
from gsfw.studies.requirements.census import Census
from gsfw.studies.requirements.worth import Worth

HARDLY_DB = 0.05
"""Gain in dB below which a part is hardly needed: seeds differ by as much."""
MENTIONED = 0.25
"""Smallest part of the Gaussians to mention: some always add next to nothing."""


def left_out(census: Census, num_rows: int) -> tuple[str, ...]:
    """Parts that some rows lack and others have, or could have by the settings."""
    found = [
        f"{_bands(degree + 1, census.highest_degree)} of {percent(count / num_rows)} of the "
        "Gaussians"
        for degree, count in enumerate(census.rows_by_degree)
        if count and degree < census.highest_degree
    ]
    if census.rows_without_time:
        part = percent(census.rows_without_time / num_rows)
        found.append(f"time parameters of {part} of the Gaussians, which stand still")
    return tuple(found)


def could_go(census: Census, worth: Worth, settings: Mapping[str, Any]) -> tuple[str, ...]:
    """Parts that the model hardly needs, with settings that leave them out."""
    found = (
        _unused_bands(census, worth),
        _idle_bands(worth, settings),
        _idle_rows(worth, settings),
    )
    return tuple(sentence for sentence in found if sentence)


def headline(census: Census, worth: Worth, settings: Mapping[str, Any], num_rows: int) -> str:
    """A summary in one line: what colours take, and what the model would lose without its parts."""
    if not census.rows_by_degree:
        said = f"the model takes {sum(census.floats.values()):,} numbers"
    else:
        said = f"colour takes {census.sh_floats / max(num_rows, 1):.3g} numbers for each Gaussian"
        if census.sh_floats < census.sh_floats_full:
            said += f" ({census.sh_floats_full / num_rows:.3g} with every band)"
    falls = [_fall_without_bands(worth, settings)] if census.rows_by_degree and worth.bands else []
    if worth.motion is not None:
        falls.append(f"{decibels(worth.motion.bought_db)} without motion")
    falls.extend(_fall_without_rows(worth, settings))
    return f"{said}; PSNR falls by {', by '.join(falls)}" if falls else said


def _fall_without_bands(worth: Worth, settings: Mapping[str, Any]) -> str:
    """Loss without the bands that gain hardly anything, else without those above the first."""
    top, idle = len(worth.bands), _first_idle_band(worth)
    first = idle if idle <= top else min(2, top)
    ways = {"sh": "adaptive", "sh_degree": idle - 1} if idle <= top else {}
    db = decibels(sum(worth.bands[first - 1 :]))
    return f"{db} without {_bands(first, top)}{_try(settings, ways)}"


def _fall_without_rows(worth: Worth, settings: Mapping[str, Any]) -> list[str]:
    """Loss without the least useful Gaussians, where it is hardly any."""
    return [
        f"{decibels(item.bought_db)} without the least useful {percent(item.part)} of the "
        f"Gaussians{_try(settings, {'strategy.budget': 'auto'})}"
        for item in _idle_parts(worth)[-1:]
    ]


def _unused_bands(census: Census, worth: Worth) -> str:
    first, top = len(worth.bands) + 1, len(census.rows_by_degree) - 1
    if first > top:
        return ""
    return f"{_bands(first, top)}: training ended before they were rendered"


def _idle_bands(worth: Worth, settings: Mapping[str, Any]) -> str:
    """The upper bands that together gain hardly anything; empty for none."""
    first = _first_idle_band(worth)
    if first > len(worth.bands):
        return ""
    return _bought(first, worth) + _try(settings, {"sh": "adaptive", "sh_degree": first - 1})


def _first_idle_band(worth: Worth) -> int:
    """The lowest band that gains hardly anything together with all above it; else one too many."""
    degree = len(worth.bands)
    while degree and sum(worth.bands[degree - 1 :]) < HARDLY_DB:
        degree -= 1
    return degree + 1


def _idle_rows(worth: Worth, settings: Mapping[str, Any]) -> str:
    """The least useful Gaussians that gain hardly anything; empty for none."""
    idle = _idle_parts(worth)
    if not idle:
        return ""
    return (
        f"the least useful {percent(idle[-1].part)} of the Gaussians hold "
        f"{percent(idle[-1].contribution)} of the contribution and bought "
        f"{decibels(idle[-1].bought_db)}" + _try(settings, {"strategy.budget": "auto"})
    )


def _idle_parts(worth: Worth) -> list[LeastUseful]:
    """The measured parts of the least useful Gaussians that gain hardly anything."""
    idle = [item for item in worth.least_useful if item.bought_db < HARDLY_DB]
    return [item for item in idle if item.part >= MENTIONED]


def _try(settings: Mapping[str, Any], ways: Mapping[str, object]) -> str:
    """The settings of ``ways`` that this run has with another value."""
    there = [f"{key}={v}" for key, v in ways.items() if key in settings and settings[key] != v]
    return f" (try {' or '.join(there)})" if there else ""


def _bought(first: int, worth: Worth) -> str:
    """Gain of the bands from ``first`` on."""
    db = decibels(sum(worth.bands[first - 1 :]))
    return f"{_bands(first, len(worth.bands))} bought {db}"


def _bands(first: int, last: int) -> str:
    return f"band {first}" if first == last else f"bands {first} to {last}"


def decibels(value: float) -> str:
    """A gain for people."""
    return f"{round(value, 2) + 0.0:.2f} dB"  # Adding zero takes the sign from a rounded -0.


def percent(part: float) -> str:
    """A part of the whole for people."""
    percent = 100 * part
    if 0 < percent < 0.01:
        return "under 0.01 %"
    return f"{percent:.0f} %" if percent >= 9.95 else f"{percent:.2g} %"
