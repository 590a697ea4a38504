"""Opacity reset: lowers all opacities at intervals, so that useless rows stay faint.

Kerbl et al. 2023, section 5.2: rows with a use recover within some hundred steps, floaters
close to the cameras do not, and are pruned.

Difference from the released code: there is no reset after which nothing can come back, because the
run ends before, or because nothing has come back from the last one.
"""

from __future__ import annotations

import torch

from gsfw.core.loop.schedule import RECOVERY
from gsfw.core.model import DensifiableModel
from gsfw.core.refiner import RESET, RefineContext, Refinement, Refiner

RECOVERED = 0.01
"""Least part of the rows that are above twice the cap, before they are capped again. Measured: 0.56
to 0.98 before the resets of sound runs (fox and chair, 1600 steps)."""


class OpacityReset(Refiner):
    """Caps every opacity at regular steps while rows grow."""

    name = "opacity-reset"

    def __init__(self, every: int, opacity: float, stop: int) -> None:
        """Set the schedule.

        Args:
            every: steps between resets, at least 1.
            opacity: the cap, in (0, 1).
            stop: no reset from this step on.
        """
        self._every, self._opacity, self._stop = every, opacity, stop

    def reset_due(self, step: int) -> bool:
        """True at regular steps while rows grow."""
        return step + 1 < self._stop and (step + 1) % self._every == 0

    def refine(self, context: RefineContext) -> Refinement:
        """Lower opacities if a reset is due; moments of Adam restart at zero."""
        is_over = context.steps - context.done < min(RECOVERY, self._every)
        held = not context.limits.may_grow or context.limits.hold
        if not self.reset_due(context.step) or is_over or held:
            return {}
        assert isinstance(context.model, DensifiableModel)
        recovered = (context.model.opacities() > 2 * self._opacity).double().mean() >= RECOVERED
        # The choice stays on the device: the host need not wait for it.
        changed = context.model.change_opacities_(
            lambda values: torch.where(recovered, values.clamp_max(self._opacity), values)
        )
        context.table.reset_columns(changed)
        return {RESET: len(context.table)}
