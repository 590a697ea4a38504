"""Large step: a training with very many Gaussians, and the memory that was estimated before it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from training_runs import QUIET, Verdict, judge, run_verb
from wild_captures import photographed

from gsfw.core.training_memory import TrainingMemory, row_memory

DEGREE, COLUMN_BYTES, LARGEST_BYTES = 1, 4.0 * (3 + 4 + 3 + 1 + 4 * 3), 4.0 * 3 * 3
"""Degree of SH, and bytes of the columns of a Gaussian and of the largest of them."""
WITHIN = 0.15
"""Part of the estimate that a measurement may differ by."""
SECONDS = 3600.0


@dataclass(frozen=True)
class LargeStep:
    """A training of a few steps."""

    gaussians: int
    estimated: float
    """Bytes."""
    measured: float
    """Bytes; 0 if it failed."""
    reason: str = ""
    """The end of the run, where it failed."""

    @property
    def holds(self) -> bool:
        """True if it took about what was estimated."""
        return abs(self.measured / self.estimated - 1) <= WITHIN

    def __str__(self) -> str:
        return (
            f"{self.gaussians:,} Gaussians: {self.estimated / 1e9:.2f} GB estimated, "
            f"{self.measured / 1e9:.2f} GB measured {self.reason}"
        ).rstrip()


def large_step(gaussians: int, folder: Path) -> LargeStep:
    """Train two steps of so many Gaussians, at random places in the built-in scene.

    Args:
        gaussians: their number.
        folder: empty; for the data and the run.
    """
    few = photographed(moving=False)
    generator = np.random.default_rng(0)
    low, high = few.points.min(0), few.points.max(0)
    capture = replace(
        few,
        points=generator.uniform(low, high, (gaussians, 3)),
        colors=generator.uniform(0, 1, (gaussians, 3)),
    )
    data, out = capture.write(folder / "data"), folder / "run"
    words = [
        *QUIET,
        f"data={data}",
        f"sh_degree={DEGREE}",
        "strategy=none",
        "steps=2",
        f"out={out}",
    ]
    ended = run_verb(["train", "method=3dgs", *QUIET, *words], folder, SECONDS)
    judged = judge(ended, out)
    height, width = few.images[0].shape[:2]
    images = len(few.images) * width * height * 3
    need = TrainingMemory(
        gaussians, row_memory(COLUMN_BYTES, LARGEST_BYTES), gaussians, width * height, images
    )
    reason = "" if judged.verdict is Verdict.SURVIVED else f"({judged.reason})"
    return LargeStep(gaussians, need.total, 0.0 if reason else ended.peak_bytes, reason)
