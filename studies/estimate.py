"""Estimate: how long a run will take, from those that were made."""

from __future__ import annotations

from collections.abc import Iterable
from statistics import mean

from gsfw.studies.planned_run import PlannedRun
from gsfw.studies.result import Result

START_SECONDS = 8.0
"""From the start of a process to its first step, and from its last to its end, about; where
nothing was measured yet."""

STEP_SECONDS = 0.1
"""Of a step, where nothing was measured yet: half-resolution pictures on two cores, about."""


class Estimate:
    """Seconds per step, by what is most like a run: its cell, then its scene, its row, any."""

    def __init__(self, results: Iterable[Result]) -> None:
        timed = [r for r in results if r.figures.get("steps") and "train_seconds" in r.figures]
        self._measured = [
            (result.row, result.scene, result.figures["train_seconds"] / result.figures["steps"])
            for result in timed
        ]
        self._starts = [
            max(0.0, result.figures["wall_seconds"] - result.figures["train_seconds"])
            for result in timed
            if "wall_seconds" in result.figures
        ]

    def seconds(self, run: PlannedRun) -> float:
        """Of the rest of a run, from its last checkpoint on."""
        left = run.steps - (run.steps_done() or 0)
        start = mean(self._starts) if self._starts else START_SECONDS
        return start + left * self._step_seconds(run)

    def _step_seconds(self, run: PlannedRun) -> float:
        row, scene = run.cell.row, run.cell.scene
        same_cell = [s for r, c, s in self._measured if (r, c) == (row, scene)]
        same_scene = [s for _, c, s in self._measured if c == scene]
        same_row = [s for r, _, s in self._measured if r == row]
        for alike in (same_cell, same_scene, same_row, [s for _, _, s in self._measured]):
            if alike:
                return mean(alike)
        return STEP_SECONDS

    @property
    def is_measured(self) -> bool:
        """Whether it rests on any run."""
        return bool(self._measured)
