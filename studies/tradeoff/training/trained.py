"""Trained: the figures of a variant that was trained, and what nothing beats among several."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from gsfw.studies.result import Result
from gsfw.studies.tradeoff.front import SAME_PSNR, Point, front
from gsfw.studies.tradeoff.training.choice import BASELINE
from gsfw.studies.tradeoff.training.judge import DRAW_MS, DRAW_SPREAD
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
    peak_memory_mb: float | None = None
    """Of its process; ``None`` where it is not known."""
    again: float | None = None
    """PSNR with another seed; ``None`` where there was no time for that."""
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
        peak_memory_mb=figures.get("peak_memory_mb"),
        again=None if again is None else float(again.figures[PSNR]),
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
    """What nothing beats, by one of ``COSTS``; sizes are exact, and times have their spread."""
    priced = [(item, price) for item in found if (price := item.cost(cost)) is not None]
    points = [Point(item.name, price, item.psnr) for item, price in priced]
    same = 0.0
    if cost == "ms":
        points = [Point(p.name, math.log(p.cost), p.quality) for p in points]
        same = 2 * median(item.draw_spread_ms / price for item, price in priced) if priced else 0.0
    found_points = front(points, math.log1p(same), same_psnr(found))
    if cost != "ms":
        return found_points
    return [Point(p.name, math.exp(p.cost), p.quality) for p in found_points]
