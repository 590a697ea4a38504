"""Goal: ends a run at a PSNR, or when more steps stop paying, by the views that it holds back.

The held-out views of the evaluation are not looked at: the views are training views
(``held_back``). When the goal is reached, the run trains on all views again and walks through what
is left of its schedule in a short last part, so that rates decay to their ends as in every run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import torch

from gsfw.core.datamanager import Split
from gsfw.core.loop.training_parts import TrainingParts, TrainingPlan
from gsfw.core.metrics import is_hidden, psnr

EVERY = 100
"""Updates between two looks: a look at four views takes 1 to 2 % of the time of these."""
LEAST_UPDATES = 500
"""Updates before the first verdict on whether more steps pay."""
WINDOW = 0.3
"""More steps stop paying when the best look of this last part of the updates is no better than the
best one before, by ``WORTH``. Shorter windows could lie in the recovery from an opacity reset."""
WORTH = 0.1
"""PSNR in dB that the last ``WINDOW`` of a run has to gain. Two seeds differ by as much."""
GAIN = 0.5
"""PSNR in dB that the last part gains, as rates decay: so far below a value it begins."""
LAST_PART, LEAST_LAST = 0.25, 50
"""Updates of the last part over those before it, and at least so many."""


class Goal:
    """Judges a run by its looks at the views that it holds back."""

    def __init__(self, target: float | None) -> None:
        """Start without a look.

        Args:
            target: PSNR in dB at which the run is to end; ``None``: when more steps stop paying.
        """
        self._target = target
        self.looks: list[tuple[int, float]] = []
        """Number of updates and PSNR in dB of each look."""
        self.reached: int | None = None
        """Number of updates after which the last part, which leads to it, began; ``None``: none."""

    def due(self, updates: int) -> bool:
        """True if a look is due after so many updates."""
        return self.reached is None and updates % EVERY == 0

    def judge(self, updates: int, found: float) -> bool:
        """Note a look; true if the last part leads to the goal from here."""
        self.looks.append((updates, found))
        target = self._target
        enough = self._pays_no_more(updates) if target is None else found >= target - GAIN
        if enough:
            self.reached = updates
        return enough

    def last_updates(self) -> int:
        """Number of updates of the last part."""
        assert self.reached is not None
        return max(round(LAST_PART * self.reached), LEAST_LAST)

    def _pays_no_more(self, updates: int) -> bool:
        began = (1 - WINDOW) * updates
        before = [value for done, value in self.looks if done <= began]
        since = [value for done, value in self.looks if done > began]
        if updates < LEAST_UPDATES or not before or not since:
            return False
        return max(since) < max(before) + WORTH

    def state_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {"looks": [list(look) for look in self.looks], "reached": self.reached}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from ``state``."""
        self.looks = [(int(done), float(value)) for done, value in state["looks"]]
        self.reached = state["reached"]


@torch.no_grad()
def mean_psnr(parts: TrainingParts, plan: TrainingPlan, step: int, views: Sequence[int]) -> float:
    """Mean PSNR of some training views at full size after ``step`` steps, in dB.

    Views without a valid pixel are left out; NaN, which reaches no goal, if all are.
    """
    settings = plan.settings
    assert settings.background is not None
    found = []
    for view in views:
        (batch,) = parts.data.load(Split.TRAIN, [view], parts.device)
        output = parts.render(batch.cameras, settings, batch.time).output
        batch = parts.compared(batch, output, settings.background, step)
        if not is_hidden(batch.valid):
            valid = None if batch.valid is None else batch.valid[0]
            found.append(psnr(output.color[0], batch.target(settings.background)[0], valid))
    return sum(found) / len(found) if found else math.nan
