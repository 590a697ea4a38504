"""Halving: which recipes are worth a longer run, after all were tried in shorter ones.

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
from gsfw.studies.tradeoff.training.choice import Recipe

COMBINATIONS = 4
"""Recipes of several choices that are tried."""


@dataclass(frozen=True)
class Goal:
    """What is asked for; ``None`` for what is not."""

    psnr: float | None = None
    """At least, in dB."""
    megabytes: float | None = None
    """Of the file, at most."""


@dataclass(frozen=True)
class Tried:
    """A recipe, and what a run of it has come to, or may come to."""

    recipe: Recipe
    psnr: float
    """In dB."""
    size: float
    """Of its file, in bytes."""

    @property
    def point(self) -> Point:
        """In the plane of size and quality."""
        return Point(self.recipe.name, self.size, self.psnr)


def survivors(tried: Sequence[Tried], count: int, goal: Goal, gain: float) -> list[Recipe]:
    """The recipes that get longer runs, the most promising first.

    With a target, those that should reach it come first, the smallest ahead, and then the others,
    the best ahead. Without one, those that nothing beats come first, then those that only they
    beat, and so on.

    Args:
        tried: recipes in runs of one length, without the baseline.
        count: how many may survive.
        goal: what is asked for; a file that is too large comes after all that are not.
        gain: what the baseline gained from this length to its longest, in dB: the guess of what
            others would.
    """
    layers = _layers(tried)

    def order(item: Tried) -> tuple[float, ...]:
        large = float(goal.megabytes is not None and item.size > 1e6 * goal.megabytes)
        if goal.psnr is None:
            return large, float(layers[item.recipe.name]), -item.psnr, item.size
        if item.psnr + gain >= goal.psnr:
            return large, 0.0, item.size, -item.psnr
        return large, 1.0, -item.psnr, item.size

    return [item.recipe for item in sorted(tried, key=order)[:count]]


def _layers(tried: Sequence[Tried]) -> dict[str, int]:
    """By name: 0 for what nothing beats, 1 for what only these beat, and so on."""
    found: dict[str, int] = {}
    left = list(tried)
    while left:
        unbeaten = [a for a in left if not any(beats(b.point, a.point) for b in left)]
        layer = max(found.values(), default=-1) + 1
        found |= {item.recipe.name: layer for item in unbeaten}
        left = [item for item in left if item.recipe.name not in found]
    return found


def combinations(
    baseline: Tried, singles: Iterable[Tried], goal: Goal, gain: float
) -> list[Recipe]:
    """Recipes of several choices that paid by themselves, the most promising first.

    A choice paid if neither the baseline nor another choice on its axis beats it. What they come to
    together is guessed: losses in dB add up, and so do the logarithms of sizes.

    Args:
        baseline: in a run of the length that the others had.
        singles: recipes of one choice.
        goal: what is asked for.
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
    return survivors(together, COMBINATIONS, goal, gain)


def _paid(baseline: Tried, items: Sequence[Tried]) -> list[Tried]:
    """Those choices on one axis that nothing on it beats."""
    every = [baseline, *items]
    return [a for a in items if not any(beats(b.point, a.point) for b in every)]


def _guess(baseline: Tried, chosen: Sequence[Tried]) -> Tried:
    recipe = Recipe(tuple(choice for item in chosen for choice in item.recipe.choices))
    psnr = baseline.psnr + sum(item.psnr - baseline.psnr for item in chosen)
    size = baseline.size * math.prod(item.size / baseline.size for item in chosen)
    return Tried(recipe, psnr, size)


def kept(count: int) -> int:
    """How many of so many survive a round: half, and at least one."""
    return max(1, count // 2)


def cost(choices: int, lengths: Sequence[float]) -> float:
    """What a search takes, in whole baselines.

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
    """How many runs a search trains."""
    total, arms = rounds, choices + (COMBINATIONS if choices > 1 else 0)
    for _ in range(rounds):
        total += arms
        arms = kept(arms)
    return total
