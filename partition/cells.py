"""Cells: rectangles of the ground that tile all of it, split such that their work is alike.

Splits at weighted medians, as in k-d trees (Bentley 1975). Lin et al., VastGaussian (CVPR 2024),
section 4.1, split by cameras in the same progressive manner; here points count as much.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float64

from gsfw.core.errors import ConfigError


@dataclass(frozen=True)
class Cell:
    """Places from ``low`` up to, and without, ``high``; outer sides are at infinity.

    Neighbours share the very number of their border, so that each place is in one cell.
    """

    low: tuple[float, float] = (-math.inf, -math.inf)
    high: tuple[float, float] = (math.inf, math.inf)

    def holds(
        self, places: Float64[np.ndarray, "p 2"], margin: float = 0.0
    ) -> Bool[np.ndarray, " p"]:
        """True for the places inside.

        Args:
            places: along the axes of the ground.
            margin: distance by which each side is moved outwards, in units of the data.
        """
        low, high = np.array(self.low) - margin, np.array(self.high) + margin
        inside = (places >= low) & (places < high)
        return inside[:, 0] & inside[:, 1]

    def split(self, axis: int, place: float) -> tuple[Cell, Cell]:
        """Both sides of a border."""
        below, above = list(self.high), list(self.low)
        below[axis] = above[axis] = place
        return (
            replace(self, high=(below[0], below[1])),
            replace(self, low=(above[0], above[1])),
        )


@dataclass(frozen=True)
class Weighted:
    """Places with the work that each of them brings."""

    places: Float64[np.ndarray, "p 2"]
    weights: Float64[np.ndarray, " p"]

    @staticmethod
    def of(points: Float64[np.ndarray, "p 2"], cameras: Float64[np.ndarray, "v 2"]) -> Weighted:
        """Points and cameras, which bring half of the work each."""
        weights = [np.full(len(part), 0.5 / max(len(part), 1)) for part in (points, cameras)]
        return Weighted(np.concatenate([points, cameras]), np.concatenate(weights))

    def within(self, cell: Cell) -> Weighted:
        """The places of a cell."""
        inside = cell.holds(self.places)
        return Weighted(self.places[inside], self.weights[inside])

    @property
    def total(self) -> float:
        """All of the work."""
        return float(self.weights.sum())

    def sides(self) -> Float64[np.ndarray, " 2"]:
        """Lengths of the box around nearly all places."""
        low, high = np.quantile(self.places, [0.02, 0.98], axis=0)
        return high - low

    def border(self, axis: int, share: float) -> float:
        """The place along an axis that has this share of the work below it.

        Raises:
            ConfigError: no border has places on both of its sides.
        """
        order = np.argsort(self.places[:, axis], kind="stable")
        sorted_places = self.places[order, axis]
        sums = np.cumsum(self.weights[order])
        after = int(np.searchsorted(sums, share * sums[-1])) if len(sums) else 0
        for last in (*range(after, len(sums) - 1), *range(min(after, len(sums) - 2), -1, -1)):
            if sorted_places[last] < sorted_places[last + 1]:
                middle = (sorted_places[last] + sorted_places[last + 1]) / 2
                return float(middle if middle > sorted_places[last] else sorted_places[last + 1])
        raise ConfigError(
            "too few points and cameras stand apart to cut the scene into so many blocks.",
            "Give fewer blocks.",
        )


def grid(items: Weighted, first: int, second: int) -> list[Cell]:
    """``first`` strips along the first axis, with ``second`` cells each; of equal work."""
    strips = _strips(items, Cell(), 0, first)
    return [cell for strip in strips for cell in _strips(items.within(strip), strip, 1, second)]


def _strips(items: Weighted, cell: Cell, axis: int, count: int) -> list[Cell]:
    found: list[Cell] = []
    for left in range(count, 1, -1):
        below, cell = cell.split(axis, items.within(cell).border(axis, 1 / left))
        found.append(below)
    return [*found, cell]


def balanced(items: Weighted, count: int, cell: Cell | None = None) -> list[Cell]:
    """Divide a cell into ``count`` cells of about equal work, across the longer sides."""
    cell = cell or Cell()
    if count == 1:
        return [cell]
    inside = items.within(cell)
    axis = _longer(inside)
    below, above = cell.split(axis, inside.border(axis, (count // 2) / count))
    return [*balanced(inside, count // 2, below), *balanced(inside, count - count // 2, above)]


def until(items: Weighted, fits: Callable[[Cell], bool], most: int) -> list[Cell]:
    """Halve cells until all of them fit, or there are ``most``."""
    done: list[Cell] = []
    waiting = [Cell()]
    while waiting:
        waiting.sort(key=lambda cell: items.within(cell).total)
        cell = waiting.pop()
        if fits(cell) or len(done) + len(waiting) + 2 > most:
            done.append(cell)
            continue
        inside = items.within(cell)
        try:
            axis = _longer(inside)
            waiting += cell.split(axis, inside.border(axis, 0.5))
        except ConfigError:  # It cannot be split: the caller says that it does not fit.
            done.append(cell)
    return sorted(done, key=lambda cell: (cell.low, cell.high))


def _longer(items: Weighted) -> int:
    if len(items.places) < 2:
        return 0
    sides = items.sides()
    return 0 if sides[0] >= sides[1] else 1
