"""Experiment: chooses the size of the runs, trains variants in rounds, and collects results."""

from __future__ import annotations

import math
import shlex
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsfw.core.config import AUTO
from gsfw.core.cores import cores
from gsfw.core.maths.flip import unavailable
from gsfw.core.random_start import random_count
from gsfw.plugins.values import as_text
from gsfw.studies.origin import origin
from gsfw.studies.planned_run import PlannedRun
from gsfw.studies.result import Failure
from gsfw.studies.runner import Ended
from gsfw.studies.study import NEUTRAL
from gsfw.studies.tradeoff import flip
from gsfw.studies.tradeoff.recommendation import Wish
from gsfw.studies.tradeoff.training.axes import BASELINE, START, STEPS
from gsfw.studies.tradeoff.training.base import Base, Capture, singles
from gsfw.studies.tradeoff.training.judge import DRAW_MS, FLIP, RunJudge
from gsfw.studies.tradeoff.training.search import Round, Search, Trial
from gsfw.studies.tradeoff.training.sizing import (
    Sizing,
    Speed,
    Work,
    choose,
    read_plan,
    sizes,
    write_plan,
)
from gsfw.studies.tradeoff.training.trained import Trained, trained
from gsfw.studies.tradeoff.training.trainer import Trainer, Workshop, measure_speeds

LENGTHS = (1 / 4, 1 / 2, 1.0)
"""Lengths of the rounds as parts of the longest."""

RESERVED = 0.05
"""Part of the time that is kept for rendering all variants in turn at the end."""

MOST_JOBS = 2
"""Runs at a time by default: parts of each step use one core."""

PLAN = "plan.json"


@dataclass(frozen=True)
class Request:
    """The question of a user."""

    axes: tuple[str, ...]
    wish: Wish
    minutes: float | None
    """Duration of everything; ``None`` for no limit."""
    data: str
    """Data set as it was typed; empty for the built-in scene."""


def usual_jobs(capture: Capture) -> int:
    """Runs at a time on one machine, where the user has not chosen."""
    return 1 if capture.device != "cpu" else min(MOST_JOBS, cores())


class Experiment:
    """The variants of a base."""

    def __init__(self, request: Request, base: Base, shop: Workshop, capture: Capture) -> None:
        """Choose the variants.

        Args:
            request: of the user.
            base: settings that are varied.
            shop: of the runs.
            capture: facts on the data set of the base.
        """
        self._request, self._unsized, self.shop = request, base, shop
        self.capture = capture
        self._choose_recipes(base)

    def _choose_recipes(self, base: Base) -> None:
        """Choose the recipes for a base, and the reasons for the others."""
        self.recipes, left_out = singles(base, self._request.axes, self.shop.registry)
        self.left_out = [*left_out, *flip.left_out()]

    @property
    def lengths(self) -> tuple[float, ...]:
        """Lengths of the rounds, as parts of the longest."""
        return LENGTHS if STEPS in self._request.axes else LENGTHS[-1:]

    def size(self) -> Sizing:
        """Choose steps and size of the images where they are not given, so that all runs fit.

        Raises:
            ConfigError: there is no time for runs that would say anything.
            DataError: a run that measures the speed has failed, or the plan is damaged.
            Stopped: the user has asked for a stop.
        """
        given, values = self._unsized.given, self._unsized.values
        steps = int(values["steps"]) if STEPS in given else None
        if self._request.minutes is None or (steps is not None and "downscale" in given):
            return Sizing(int(values["steps"]), self._unsized.downscale, None)
        request = {"minutes": self._request.minutes, "axes": sorted(self._request.axes)}
        asked = {**values, "given": sorted(given), "jobs": self.shop.jobs, **request}
        path = self.shop.folder / PLAN
        known = read_plan(path, asked)
        if known is not None:
            return known
        capture = self.capture
        work = Work(len(self.recipes), self.lengths, self.shop.jobs)
        sized = "downscale" in given
        factors = [self._unsized.downscale] if sized else list(sizes(capture.width, capture.height))
        sizing = choose(work, capture.views, factors, steps, self._measure, self._left)
        write_plan(path, asked, sizing)
        return sizing

    def _left(self) -> float:
        """Minutes that are left for runs."""
        deadline = self.shop.deadline
        return math.inf if deadline is None else (deadline - time.monotonic()) / 60

    def _measure(self, factors: Sequence[float], steps: int) -> list[Speed]:
        runs = [{**self._unsized.given, **self._at(factor)} for factor in factors]
        return measure_speeds(runs, self.shop, steps)

    def _at(self, downscale: float) -> dict[str, Any]:
        """Settings that follow from a chosen size of the images.

        The number of random Gaussians is written out, so that a smaller limit can replace it.
        """
        values, capture = self._unsized.values, self.capture
        at: dict[str, Any] = {"downscale": downscale}
        at_random = not capture.has_points or values.get("init") == "random"
        if at_random and values.get(START) == AUTO:
            smaller = downscale / self._unsized.downscale
            at[START] = random_count(int(capture.width * capture.height / smaller**2))
        return at

    def begin(self, sizing: Sizing) -> None:
        """Prepare the training."""
        base = self._unsized.sized({**self._at(sizing.downscale), "steps": sizing.steps})
        self._choose_recipes(base)
        self.judge = RunJudge(self.shop.registry, base.downscale)
        self.trainer = Trainer(base, self.shop, self.judge.accuracy)
        steps = [max(1, round(length * sizing.steps)) for length in self.lengths]
        self.search = Search(
            self.recipes, steps, base.seed, self._request.wish, self.trainer.outcome
        )

    @property
    def fewer_to_start(self) -> int | None:
        """Chosen number of random Gaussians at the start; ``None`` where it was not chosen."""
        chosen = self.trainer.base.values.get(START)
        return None if chosen == self._unsized.values.get(START) else chosen

    def rounds(self) -> Iterator[Round]:
        """Rounds in order; each has to be trained before the next is asked for."""
        for item in self.search.rounds():
            if self.shop.control.stop_reason is not None:
                return
            yield item

    def train(self, item: Round) -> Iterator[Ended]:
        """Make the missing trials of a round, as far as there is time."""
        return self.trainer.train(item.trials)

    @property
    def is_drawn(self) -> bool:
        """True if rendering times of all variants are known."""
        return all(DRAW_MS in self.shop.store.results[run.cell.key].figures for run in self._made())

    def draw(self, rounds: int) -> Iterator[int]:
        """Render all variants in turn, as far as there is time; yields the number of each round."""
        return self.judge.time(self._made(), self.shop.store, rounds, self._is_over)

    @property
    def without_flip(self) -> list[PlannedRun]:
        """Runs without FLIP, where it can be measured."""
        if unavailable():
            return []
        results = self.shop.store.results
        return [run for run in self._made() if FLIP not in results[run.cell.key].figures]

    def compare(self) -> Iterator[int]:
        """Measure missing FLIP, as far as there is time; yields the number of finished runs."""
        return self.judge.compare(self.without_flip, self.shop.store, self._is_over)

    def _is_over(self) -> bool:
        """True if the time for rendering is over too, or a stop is requested."""
        reserved = RESERVED * (self._request.minutes or 0.0)
        return self._left() + reserved < 0 or self.shop.control.stop_reason is not None

    def _made(self) -> list[PlannedRun]:
        """Every run that was trained with the first seed, once."""
        done = [trial for trial in self.search.trials if self.trainer.result(trial) is not None]
        runs = {run.fingerprint: run for t in done if (run := self.trainer.plan(t)) is not None}
        return list(runs.values())

    def found(self) -> list[Trained]:
        """Trained variants, each once, in the order of their first trials."""
        baseline = self.trainer.base.values
        found: dict[str, Trained] = {}
        for trial in self.search.trials:
            result, run = self.trainer.result(trial), self.trainer.plan(trial)
            if result is None or run is None or run.fingerprint in found:
                continue
            other = Trial(trial.recipe, trial.steps, trial.seed + 1)
            words = self._words(self.trainer.settings(trial) or {})
            again = self.trainer.result(other)
            found[run.fingerprint] = trained(trial, result, words, baseline, again)
        return list(found.values())

    def left(self) -> int:
        """Number of runs that are neither made nor failed."""
        failures = self.shop.store.failures
        runs = self.trainer.missing(self.search.asked)
        return sum(run.cell.key not in failures for run in runs)

    def why_nothing(self) -> tuple[str, str]:
        """Message and advice where no baseline was made."""
        for failure in self._failed():
            if failure.row == BASELINE:
                return f"the baseline failed: {failure.error}", failure.advice
        return "no run of the baseline was finished.", "The same command continues."

    def about(self) -> dict[str, Any]:
        """The baseline, the lengths and the machine, for the document."""
        base = self.trainer.base
        return {
            "baseline": shlex.join(["gsfw", "train", *self._words(base.given)]),
            "downscale": base.downscale,
            "steps": list(self.search.lengths),
            "jobs": self.shop.jobs,
            "views": self.capture.held_out,
            "left_out": {item.axis: item.why for item in self.left_out},
            "failed": [f"{item.row}, {item.scene}: {item.error}" for item in self._failed()],
            "left": self.left(),
            "machine": origin(),
        }

    def _failed(self) -> list[Failure]:
        """Failures of this search; the store may hold others, of earlier settings."""
        failures = self.shop.store.failures
        keys = {run.cell.key for run in self.trainer.missing(self.search.asked)}
        return [failures[key] for key in sorted(keys & failures.keys())]

    def _words(self, settings: Mapping[str, Any]) -> list[str]:
        """Settings as they are typed, without those that change no result."""
        shown = {key: value for key, value in settings.items() if key not in NEUTRAL}
        if self._request.data:
            shown["data"] = self._request.data
        return [f"{key}={as_text(value)}" for key, value in shown.items()]


def by_when(started: float, minutes: float | None) -> float | None:
    """Time by ``time.monotonic`` at which runs have to have ended; ``None`` for no limit."""
    return None if minutes is None else started + 60 * minutes * (1 - RESERVED)


def default_folder(root: Path, data: str) -> Path:
    """Folder of the runs, named like the data."""
    return root / "tradeoffs" / (Path(data).resolve().name if data else "built-in")
