"""Search: the variants to train, round by round, from the results of earlier rounds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from gsfw.studies.tradeoff.front import Point, front
from gsfw.studies.tradeoff.recommendation import Wish
from gsfw.studies.tradeoff.training.axes import Recipe
from gsfw.studies.tradeoff.training.halving import Tried, combinations, kept, survivors


@dataclass(frozen=True)
class Trial:
    """A run: its recipe, length and seed."""

    recipe: Recipe
    steps: int
    seed: int

    @property
    def name(self) -> str:
        """Name for people."""
        return f"{self.recipe.name}, {self.steps} steps"


@dataclass(frozen=True)
class Outcome:
    """The figures of a finished run by which the next ones are chosen."""

    psnr: float
    """On held-out images of the baseline's size, in dB."""
    size: float
    """Size of its file in bytes."""


@dataclass(frozen=True)
class Round:
    """Trials that can run at the same time."""

    name: str
    trials: tuple[Trial, ...]


Found = Callable[[Trial], Outcome | None]
"""The outcome of a trial; ``None`` where there was no time for it, or it failed."""


class Search:
    """The baseline at every length, single choices, combinations, and then halves of them."""

    def __init__(
        self, singles: Sequence[Recipe], lengths: Sequence[int], seed: int, wish: Wish, found: Found
    ) -> None:
        """Prepare.

        Args:
            singles: recipes of one choice.
            lengths: of the rounds in steps, the shortest first.
            seed: of all runs but those that are made again.
            wish: of the user.
            found: gives the outcome of a trial at any time.
        """
        self._singles, self.lengths = list(singles), tuple(dict.fromkeys(lengths))
        self._seed, self._wish, self._found = seed, wish, found
        self.asked: list[Trial] = []
        """Every trial of the rounds so far, in order."""

    @property
    def trials(self) -> list[Trial]:
        """Trials with the first seed."""
        return [trial for trial in self.asked if trial.seed == self._seed]

    def rounds(self) -> Iterator[Round]:
        """Rounds in order; each has to be made before the next is asked for."""
        shortest = self.lengths[0]
        baseline = [self._trial(Recipe(), steps) for steps in reversed(self.lengths)]
        free = [self._trial(r, shortest) for r in self._singles if r.part is None]
        yield from self._round("the baseline, and one change at a time", [*baseline, *free])
        bound = [self._trial(r, shortest) for r in self._singles if r.part is not None]
        yield from self._round("fewer Gaussians than the baseline", bound)
        arms = [*self._singles, *self._combinations(shortest)]
        combined = [self._trial(recipe, shortest) for recipe in arms[len(self._singles) :]]
        yield from self._round("useful changes, combined", combined)
        for before, steps in zip(self.lengths, self.lengths[1:], strict=False):
            tried = self._tried(arms, before)
            arms = survivors(tried, kept(len(arms)), self._wish, self._gain(before))
            name = f"the better half, {steps} steps"
            yield from self._round(name, [self._trial(recipe, steps) for recipe in arms])
        yield from self._round("a second seed", self._again())

    def _round(self, name: str, trials: Sequence[Trial]) -> Iterator[Round]:
        self.asked += trials
        if trials:
            yield Round(name, tuple(trials))

    def _trial(self, recipe: Recipe, steps: int) -> Trial:
        return Trial(recipe, steps, self._seed)

    def _tried(self, recipes: Sequence[Recipe], steps: int) -> list[Tried]:
        found = ((recipe, self._found(self._trial(recipe, steps))) for recipe in recipes)
        return [Tried(recipe, out.psnr, out.size) for recipe, out in found if out is not None]

    def _gain(self, steps: int) -> float:
        """Gain of the baseline from some steps to the most; 0 where it is not known."""
        ends = self._tried([Recipe()], steps), self._tried([Recipe()], self.lengths[-1])
        return ends[1][0].psnr - ends[0][0].psnr if all(ends) else 0.0

    def _combinations(self, steps: int) -> list[Recipe]:
        baseline = self._tried([Recipe()], steps)
        if not baseline:
            return []
        singles = self._tried(self._singles, steps)
        return combinations(baseline[0], singles, self._wish, self._gain(steps))

    def _again(self) -> list[Trial]:
        """The trials of the front with another seed, the shortest first, to measure the spread."""
        found = {trial.name: (trial, self._found(trial)) for trial in self.trials}
        points = [Point(n, out.size, out.psnr) for n, (_, out) in found.items() if out is not None]
        unbeaten = [found[point.name][0] for point in front(points)]
        ordered = sorted(unbeaten, key=lambda trial: trial.steps)
        return [Trial(trial.recipe, trial.steps, self._seed + 1) for trial in ordered]
