"""Sentences: missing and unneeded parts of a model, and settings to try."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

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
    """A summary in one line."""
    if not census.rows_by_degree:
        said = [f"{sum(census.floats.values()):,} floats"]
    else:
        said = [f"{census.sh_floats / max(num_rows, 1):.3g} floats each for colour"]
        if census.sh_floats < census.sh_floats_full:
            said[0] += f" ({census.sh_floats_full / num_rows:.3g} with every band)"
        bands = _idle_bands(worth, settings) or _upper_bands(worth)
        said[0] += f", of which {bands}" if bands else ""
    if worth.motion is not None:
        said.append(f"motion bought {decibels(worth.motion.bought_db)}")
    rows = _idle_rows(worth, settings)
    return "; ".join([*said, rows] if rows else said)


def _upper_bands(worth: Worth) -> str:
    """Gain of the bands above the first; of the first, if it is the only one."""
    top = len(worth.bands)
    first = min(2, top)
    return _bought(first, worth) if top else ""


def _unused_bands(census: Census, worth: Worth) -> str:
    first, top = len(worth.bands) + 1, len(census.rows_by_degree) - 1
    if first > top:
        return ""
    return f"{_bands(first, top)}: training ended before they were rendered"


def _idle_bands(worth: Worth, settings: Mapping[str, Any]) -> str:
    """The upper bands that together gain hardly anything; empty for none."""
    degree = len(worth.bands)
    while degree and sum(worth.bands[degree - 1 :]) < HARDLY_DB:
        degree -= 1
    if degree == len(worth.bands):
        return ""
    return _bought(degree + 1, worth) + _try(settings, {"sh": "adaptive", "sh_degree": degree})


def _idle_rows(worth: Worth, settings: Mapping[str, Any]) -> str:
    """The least useful Gaussians that gain hardly anything; empty for none."""
    idle = [item for item in worth.least_useful if item.bought_db < HARDLY_DB]
    idle = [item for item in idle if item.part >= MENTIONED]
    if not idle:
        return ""
    return (
        f"the least useful {percent(idle[-1].part)} of the Gaussians hold "
        f"{percent(idle[-1].contribution)} of the contribution and bought "
        f"{decibels(idle[-1].bought_db)}" + _try(settings, {"strategy.budget": "auto"})
    )


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
