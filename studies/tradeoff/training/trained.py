"""Trained: the figures of a trained variant, and the fronts of several."""

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
"""Bytes of a float: models are trained in float32."""

COSTS = ("MB", "ms", "training")
"""Costs of accuracy; each has a front."""


@dataclass(frozen=True)
class Trained:
    """A trained variant with the figures of its run."""

    variant: str
    steps: int
    words: tuple[str, ...]
    """Its settings, as they are typed after ``gsfw train``."""
    changed: Mapping[str, Any]
    """The settings that differ from the baseline's."""
    psnr: float
    """In dB, on held-out images of the baseline's size."""
    ssim: float
    file_mb: float
    """Megabytes of its splats file, or of its parameters."""
    model_bytes: int
    """Bytes of its parameters in memory."""
    num_gaussians: int
    train_seconds: float
    draw_ms: float | None = None
    """Milliseconds to render a view; ``None`` before the measurement."""
    draw_spread_ms: float = 0.0
    flip: float | None = None
    """Mean FLIP of some of these views; ``None`` if unknown."""
    peak_memory_mb: float | None = None
    """Peak memory of its process; ``None`` if unknown."""
    again: float | None = None
    """PSNR with another seed; ``None`` where there was no time for it."""
    seconds_again: float | None = None
    """Seconds of training with another seed."""
    axes: tuple[str, ...] = ()
    """Axes along which it differs from the baseline, without the length."""

    @property
    def name(self) -> str:
        """Name of this variant at this length."""
        return f"{self.variant}, {self.steps} steps"

    @property
    def floats(self) -> int:
        """Number of stored floats."""
        return self.model_bytes // FLOAT_BYTES

    @property
    def is_baseline(self) -> bool:
        """True if it is the baseline, at any length."""
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
    """Read a result.

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
    """Given values that differ from the baseline; as values, since their text may vary."""
    given = {key: result.settings.get(key, value) for key, value in result.given.items()}
    return {key: value for key, value in given.items() if baseline.get(key, value) != value}


def spread(found: Sequence[Trained]) -> float | None:
    """Standard deviation of PSNR over seeds, in dB, pooled; ``None`` where no seed was changed."""
    pairs = [item.psnr - item.again for item in found if item.again is not None]
    if not pairs:
        return None
    return math.sqrt(sum(pair**2 / 2 for pair in pairs) / len(pairs))


def same_psnr(found: Sequence[Trained]) -> float:
    """Decibels up to which two variants are a tie: both spreads, or the last shown digit."""
    return max(SAME_PSNR, 2 * (spread(found) or 0.0))


def unbeaten(found: Sequence[Trained], cost: str) -> list[Point]:
    """The variants that no other beats, by one of ``COSTS``; costs are compared by their ratio."""
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
