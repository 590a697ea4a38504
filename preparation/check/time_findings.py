"""Findings about times: number, gaps, cameras at each time, and motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gsfw.preparation.check.survey import Survey
from gsfw.preparation.check.viewpoints import Viewpoints
from gsfw.preparation.finding import Finding, Weight

FEW_TIMES = 5
"""With fewer, motion between times is a guess."""
GAP, GAP_PART = 3.0, 0.05
"""A gap is longer than so many usual steps, and than this part of the whole time: times that were
drawn at random (mujoco_collision) have steps of 5 usual ones, none above 0.03 of the whole."""
STILL = 10 / 255
"""Colours that differ by less over time stand still: JPEG and sensors add about 4 of 255."""
FEW_MOVES = 0.01
"""Part of the pixels that has to change for a dynamic method to be worth it."""
SEVERAL = 3
"""Cameras at each time from which on ``dynamic3dgs`` can follow in depth."""


def cameras_at_times(viewpoints: Viewpoints) -> float:
    """Median number of trained views at each time; 0 for a static capture."""
    times = viewpoints.times
    if times is None:
        return 0.0
    _, counts = np.unique(times[viewpoints.trained], return_counts=True)
    return float(np.median(counts)) if len(counts) else 0.0


def still_share(survey: Survey) -> float | None:
    """Part of the pixels of standing cameras that never change; ``None`` where none stands."""
    viewpoints = survey.viewpoints
    if not viewpoints.stand_still:
        return None
    groups: dict[int, list[np.ndarray]] = {}
    for image in survey.sample.images:
        groups.setdefault(int(viewpoints.place_of[image.view]), []).append(image.preview)
    shares = []
    for previews in groups.values():
        if len(previews) > 2 and len({preview.shape for preview in previews}) == 1:
            change = np.ptp(np.stack(previews), axis=0).max(2)
            shares.append(float((change < STILL).mean()))
    return float(np.mean(shares)) if shares else None


def time_findings(survey: Survey) -> Iterator[Finding]:
    """Everything that times show; nothing for a static capture."""
    if survey.scene.num_times < 2 or survey.viewpoints.times is None:
        return
    yield from _order(survey)
    yield from _number(survey)
    yield from _held_out(survey)
    yield from _cameras(survey)
    yield from _motion(survey)


def _order(survey: Survey) -> Iterator[Finding]:
    order = survey.time_order
    if order is not None and order.shuffled:
        yield Finding(
            "times out of order",
            Weight.STOP,
            f"Images of a standing camera at neighbouring times differ by {100 * order.given:.0f} "
            f"% of what any two of its images differ by; in another order, by "
            f"{100 * order.best:.0f} %.",
            "Motion that jumps back and forth cannot be followed.",
            "The times belong to other images: were frames renamed, or sorted as text (1, 10, 2)?",
        )


def _number(survey: Survey) -> Iterator[Finding]:
    times = survey.viewpoints.times
    assert times is not None
    distinct = np.unique(times)
    if len(distinct) < FEW_TIMES:
        yield Finding(
            "few times",
            Weight.LIMIT,
            f"There are {len(distinct)} different times.",
            "What happens between them is guessed.",
            "Use more frames of the videos.",
        )
    steps = np.diff(distinct)
    usual = float(np.median(steps)) if len(steps) else 0.0
    gaps = np.flatnonzero(steps > max(GAP * usual, GAP_PART))
    if len(steps) > 2 and len(gaps):
        worst = int(gaps[np.argmax(steps[gaps])])
        first, last = (_data_time(survey, distinct[i]) for i in (worst, worst + 1))
        yield Finding(
            "gaps in time",
            Weight.LIMIT,
            f"{len(gaps)} steps between times are far longer than usual, the longest "
            f"from {first:.4g} to {last:.4g}.",
            "Motion there is guessed.",
            "Add the missing frames, or train the parts apart.",
        )


def _held_out(survey: Survey) -> Iterator[Finding]:
    """Held-out views beyond the first or the last trained time, by more than a gap."""
    times, trained = survey.viewpoints.times, survey.viewpoints.trained
    assert times is not None
    held, shown = times[~trained], np.unique(times[trained])
    slack = max(GAP * float(np.median(np.diff(shown))) if len(shown) > 1 else 0.0, GAP_PART)
    beyond = held[(held < shown[0] - slack) | (held > shown[-1] + slack)]
    if len(beyond) == 0:
        return
    ends = (beyond.min(), beyond.max(), shown[0], shown[-1])
    first, last, begin, end = (f"{_data_time(survey, time):.4g}" for time in ends)
    yield Finding(
        "held-out times not trained",
        Weight.LIMIT,
        f"{len(beyond)} of {len(held)} held-out views are at times from {first} to {last}; the "
        f"trained ones are from {begin} to {end}.",
        "No trained image shows what happens then, so their PSNR does not rate the model.",
        "Do all splits count time from the same moment? Else name other views: holdout=NAME,...",
    )


def _data_time(survey: Survey, time: float) -> float:
    first, last = survey.scene.time_range or (0.0, 1.0)
    return first + float(time) * (last - first)


def _cameras(survey: Survey) -> Iterator[Finding]:
    count = cameras_at_times(survey.viewpoints)
    if count < 2:
        yield Finding(
            "one camera at each time",
            Weight.NOTE,
            "Each time is seen by one camera.",
            "Depth of what moves is never measured, only assumed to change smoothly; "
            "dynamic3dgs cannot follow.",
            "Use method=4dgs, 4d-rotor or spacetime.",
        )
    elif count < SEVERAL:
        yield Finding(
            "two cameras at each time",
            Weight.LIMIT,
            f"Each time is seen by {count:g} cameras.",
            "What only one of them sees has no depth while it moves.",
            "Add cameras; dynamic3dgs needs at least three.",
        )


def _motion(survey: Survey) -> Iterator[Finding]:
    share = still_share(survey)
    if share is not None and 1 - share < FEW_MOVES:
        yield Finding(
            "hardly anything moves",
            Weight.NOTE,
            f"{100 * share:.1f} % of the pixels never change by more than {255 * STILL:.0f} of "
            "255.",
            "A static method is then simpler and faster.",
            "Try method=3dgs ignore_time=true.",
        )
