"""Front: the variants that no other beats, where differences within the spread are ties.

Pareto's order with a tolerance for each axis: one point beats another if it is better on one axis
by more than the tolerance, and on the other not worse by more than that. As each tolerance is the
same for all points, no circle of points can beat one another: along a circle differences add up to
0, so each axis has more steps that are worse within its tolerance than steps that are better beyond
it, and every step of the first kind on one axis is of the second kind on the other.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from gsfw.studies.tradeoff.record import Record
from gsfw.studies.tradeoff.variant import STORAGE

SAME_PSNR = 0.01
"""Decibels of the last shown digit: rendering the same views again gives the same bits."""


@dataclass(frozen=True)
class Point:
    """A variant in a plane of cost and quality."""

    name: str
    cost: float
    """The less, the better."""
    quality: float
    """The more, the better."""


def beats(first: Point, second: Point, same_cost: float = 0.0, same_quality: float = 0.0) -> bool:
    """True if ``first`` is better than ``second`` on one axis, and not worse on the other.

    Args:
        first: a point.
        second: another.
        same_cost: costs that differ by no more are a tie.
        same_quality: the same for qualities.
    """
    cheaper, better = second.cost - first.cost, first.quality - second.quality
    not_worse = cheaper >= -same_cost and better >= -same_quality
    return not_worse and (cheaper > same_cost or better > same_quality)


def front(
    points: Sequence[Point], same_cost: float = 0.0, same_quality: float = 0.0
) -> list[Point]:
    """The points that no other beats, by cost; empty only for no points."""
    unbeaten = [
        point
        for point in points
        if not any(beats(other, point, same_cost, same_quality) for other in points)
    ]
    return sorted(unbeaten, key=lambda point: (point.cost, -point.quality))


def size_front(records: Iterable[Record]) -> list[Point]:
    """PSNR against megabytes, of variants that change the storage; sizes are exact."""
    points = [
        Point(f"{r.axis}: {r.name}", r.size / 1e6, r.psnr)
        for r in records
        if r.psnr is not None and r.axis in STORAGE
    ]
    return front(points, same_quality=SAME_PSNR)


def time_front(records: Sequence[Record]) -> list[Point]:
    """PSNR against milliseconds, of variants with times of their own.

    Times are compared by their ratio, with twice the usual spread as tolerance.
    """
    timed = {f"{r.axis}: {r.name}": r for r in records if r.ms and r.psnr is not None}
    points = [
        Point(name, math.log(record.ms or 1.0), record.psnr or 0.0)
        for name, record in timed.items()
    ]
    found = front(points, same_time(list(timed.values())), SAME_PSNR)
    return [Point(point.name, math.exp(point.cost), point.quality) for point in found]


def same_time(records: Sequence[Record]) -> float:
    """Logarithm of the ratio up to which two times are a tie; infinite for unknown spreads."""
    spreads = [r.ms_spread / r.ms for r in records if r.ms and r.ms_spread is not None]
    return math.log1p(2 * median(spreads)) if spreads else math.inf
