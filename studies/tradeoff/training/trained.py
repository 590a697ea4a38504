"""Trained: the figures of a variant that was trained, and what nothing beats among several."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import mean, median
from typing import Any

from gsfw.studies.result import Result
from gsfw.studies.tradeoff.front import SAME_PSNR, Point, front
from gsfw.studies.tradeoff.training.axes import BASELINE
from gsfw.studies.tradeoff.training.judge import DRAW_MS, DRAW_SPREAD, FLIP
from gsfw.studies.tradeoff.training.search import Trial
from gsfw.studies.tradeoff.training.trainer import PSNR, SSIM, megabytes

FLOAT_BYTES = 4
"""Models are trained in float32."""

COSTS = ("MB", "ms", "training")
"""What accuracy is weighed against; a front for each."""


@dataclass(frozen=True)
class Trained:
    """A variant that was trained, and the figures of its run."""

    variant: str
    steps: int
    words: tuple[str, ...]
    """Its settings, as one types them after ``gsfw train``."""
    changed: Mapping[str, Any]
    """Those that differ from the baseline's."""
    psnr: float
    """In dB, on the held-out views in the size of the baseline's pictures."""
    ssim: float
    file_mb: float
    """Of the splats that it writes, or of its parameters, in megabytes."""
    model_bytes: int
    """Of its parameters in memory."""
    num_gaussians: int
    train_seconds: float
    draw_ms: float | None = None
    """To draw a view; ``None`` before that was measured."""
    draw_spread_ms: float = 0.0
    flip: float | None = None
    """Mean of FLIP over some of the same views; ``None`` where it is not known."""
    peak_memory_mb: float | None = None
    """Of its process; ``None`` where it is not known."""
    again: float | None = None
    """PSNR with another seed; ``None`` where there was no time for that."""
    seconds_again: float | None = None
    """Of training with another seed."""
    axes: tuple[str, ...] = ()
    """Along which it differs from the baseline, length aside."""

    @property
    def name(self) -> str:
        """Of this variant at this length."""
        return f"{self.variant}, {self.steps} steps"

    @property
    def floats(self) -> int:
        """Numbers that it stores."""
        return self.model_bytes // FLOAT_BYTES

    @property
    def is_baseline(self) -> bool:
        """Whether nothing but the length differs."""
        return self.variant == BASELINE

    def cost(self, cost: str) -> float | None:
        """One of ``COSTS``: megabytes, milliseconds, or seconds of training."""
        return {"MB": self.file_mb, "ms": self.draw_ms, "training": self.train_seconds}[cost]


def trained(
    trial: Trial,
    result: Result,
    words: Sequence[str],
    baseline: Mapping[str, Any],
    again: Result | None,
) -> Trained:
    """What a result says.

    Args:
        trial: that was made.
        result: of it.
        words: settings, as one types them.
        baseline: every setting of the baseline.
        again: result with another seed; ``None`` for none.
    """
    figures = result.figures
    return Trained(
        variant=trial.recipe.name,
        steps=trial.steps,
        words=tuple(words),
        changed=_changed(result, baseline),
        psnr=float(figures[PSNR]),
        ssim=float(figures[SSIM]),
        file_mb=megabytes(result),
        model_bytes=int(figures["model_bytes"]),
        num_gaussians=int(figures["num_gaussians"]),
        train_seconds=float(figures["train_seconds"]),
        draw_ms=figures.get(DRAW_MS),
        draw_spread_ms=float(figures.get(DRAW_SPREAD, 0.0)),
        flip=figures.get(FLIP),
        peak_memory_mb=figures.get("peak_memory_mb"),
        again=None if again is None else float(again.figures[PSNR]),
        seconds_again=None if again is None else float(again.figures["train_seconds"]),
        axes=tuple(choice.axis for choice in trial.recipe.choices),
    )


def _changed(result: Result, baseline: Mapping[str, Any]) -> dict[str, Any]:
    """What was given and differs from the baseline; as values, of which texts may be many."""
    given = {key: result.settings.get(key, value) for key, value in result.given.items()}
    return {key: value for key, value in given.items() if baseline.get(key, value) != value}


def spread(found: Sequence[Trained]) -> float | None:
    """Standard deviation of PSNR over seeds, in dB, pooled; ``None`` where no seed was changed."""
    pairs = [item.psnr - item.again for item in found if item.again is not None]
    if not pairs:
        return None
    return math.sqrt(sum(pair**2 / 2 for pair in pairs) / len(pairs))


def same_psnr(found: Sequence[Trained]) -> float:
    """Decibels up to which two variants are a tie: both spreads, or the last digit shown."""
    return max(SAME_PSNR, 2 * (spread(found) or 0.0))


def unbeaten(found: Sequence[Trained], cost: str) -> list[Point]:
    """What nothing beats, by one of ``COSTS``; costs are compared by their ratio."""
    prices = {item.name: price for item in found if (price := item.cost(cost))}
    points = [Point(i.name, math.log(prices[i.name]), i.psnr) for i in found if i.name in prices]
    chosen = front(points, _same_cost(found, cost), same_psnr(found))
    return [Point(point.name, prices[point.name], point.quality) for point in chosen]


def _same_cost(found: Sequence[Trained], cost: str) -> float:
    """Logarithm of the ratio up to which costs are a tie: sizes are exact, times twice a spread.

    That of drawing is between rounds, that of training between seeds; 0 where it is not known.
    """
    if cost == "ms":
        spreads = [item.draw_spread_ms / item.draw_ms for item in found if item.draw_ms]
        return math.log1p(2 * median(spreads)) if spreads else 0.0
    if cost == "training":
        pairs = [(item.train_seconds, item.seconds_again) for item in found]
        logs = [math.log(first / again) for first, again in pairs if first and again]
        return 2 * math.sqrt(mean(log**2 / 2 for log in logs)) if logs else 0.0
    return 0.0
