"""Halving: the choice of recipes that get longer runs, from the results of shorter ones.

Successive halving (Jamieson and Talwalkar 2016, "Non-stochastic Best Arm Identification and
Hyperparameter Optimization", AISTATS): all arms get a small budget, the better half twice as much,
and so on, so that every round costs about the same. It is one bracket of Hyperband (Li et al.
2018, JMLR 18); the other brackets, which trust short runs less, are left out.

Where we differ: there, an arm that is promoted goes on from where it was. Here each round trains
whole runs anew, with every schedule rescaled to their length. The beginning of a long run says
little: rates are still high, higher bands of colour not yet trained, and most limits not yet
reached, so that a quarter of a run of every recipe looks like that of the baseline. A short whole
run is a finished model, whose figures are true of it and which may be the one to recommend. That
costs half as much again at most, and needs no checkpoints.

Arms are compared by two figures that are the same on every machine, PSNR and bytes; not by time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

from gsfw.studies.tradeoff.front import Point, beats
from gsfw.studies.tradeoff.recommendation import Wish
from gsfw.studies.tradeoff.training.axes import Recipe

COMBINATIONS = 4
"""Number of tried recipes of several choices."""


@dataclass(frozen=True)
class Tried:
    """A recipe with the result of a run of it, or with a guess of that."""

    recipe: Recipe
    psnr: float
    """PSNR in dB."""
    size: float
    """Size of its file in bytes."""

    @property
    def point(self) -> Point:
        """The point in the plane of size and quality."""
        return Point(self.recipe.name, self.size, self.psnr)


def survivors(tried: Sequence[Tried], count: int, wish: Wish, gain: float) -> list[Recipe]:
    """Choose the recipes that get longer runs, the most promising first.

    With a target, recipes that should reach it come first, the smallest ahead, then the others, the
    best ahead. Without a target, recipes that none beats come first, then those that only these
    beat, and so on.

    Args:
        tried: recipes in runs of one length, without the baseline.
        count: number of survivors.
        wish: of the user; files that are too large come last.
        gain: of the baseline from this length to its longest, in dB; the others should gain as
            much.
    """
    layers = _layers(tried)

    def order(item: Tried) -> tuple[float, ...]:
        large = float(wish.megabytes is not None and item.size > 1e6 * wish.megabytes)
        if wish.psnr is None:
            return large, float(layers[item.recipe.name]), -item.psnr, item.size
        if item.psnr + gain >= wish.psnr:
            return large, 0.0, item.size, -item.psnr
        return large, 1.0, -item.psnr, item.size

    return [item.recipe for item in sorted(tried, key=order)[:count]]


def _layers(tried: Sequence[Tried]) -> dict[str, int]:
    """Layer by name: 0 for recipes that none beats, 1 for those that only layer 0 beats, ..."""
    found: dict[str, int] = {}
    left = list(tried)
    while left:
        unbeaten = [a for a in left if not any(beats(b.point, a.point) for b in left)]
        layer = max(found.values(), default=-1) + 1
        found |= {item.recipe.name: layer for item in unbeaten}
        left = [item for item in left if item.recipe.name not in found]
    return found


def combinations(
    baseline: Tried, singles: Iterable[Tried], wish: Wish, gain: float
) -> list[Recipe]:
    """Recipes of several choices that paid by themselves, the most promising first.

    A choice paid if neither the baseline nor another choice on its axis beats it. The result of
    several is guessed: losses in dB add up, and so do the logarithms of sizes.

    Args:
        baseline: in a run of the length that the others had.
        singles: recipes of one choice.
        wish: of the user.
        gain: as in ``survivors``.
    """
    by_axis: dict[str, list[Tried]] = {}
    for item in singles:
        by_axis.setdefault(item.recipe.choices[0].axis, []).append(item)
    paid = [_paid(baseline, items) for items in by_axis.values()]
    together = []
    for picked in product(*([None, *items] for items in paid)):
        chosen = [item for item in picked if item is not None]
        if len(chosen) > 1:
            together.append(_guess(baseline, chosen))
    return survivors(together, COMBINATIONS, wish, gain)


def _paid(baseline: Tried, items: Sequence[Tried]) -> list[Tried]:
    """The choices on one axis that nothing on this axis beats."""
    every = [baseline, *items]
    return [a for a in items if not any(beats(b.point, a.point) for b in every)]


def _guess(baseline: Tried, chosen: Sequence[Tried]) -> Tried:
    recipe = Recipe(tuple(choice for item in chosen for choice in item.recipe.choices))
    psnr = baseline.psnr + sum(item.psnr - baseline.psnr for item in chosen)
    size = baseline.size * math.prod(item.size / baseline.size for item in chosen)
    return Tried(recipe, psnr, size)


def kept(count: int) -> int:
    """Number of recipes that survive a round: half, and at least one."""
    return max(1, count // 2)


def cost(choices: int, lengths: Sequence[float]) -> float:
    """Length of a search, in whole baselines.

    Args:
        choices: single choices that are tried.
        lengths: of the rounds, as parts of the longest, the shortest first.
    """
    total, arms = sum(lengths), choices + (COMBINATIONS if choices > 1 else 0)
    for length in lengths:
        total += arms * length
        arms = kept(arms)
    return total


def number_of_runs(choices: int, rounds: int) -> int:
    """Number of runs of a search."""
    total, arms = rounds, choices + (COMBINATIONS if choices > 1 else 0)
    for _ in range(rounds):
        total += arms
        arms = kept(arms)
    return total
