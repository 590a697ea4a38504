"""Opacity reset: lowers all opacities at intervals, so that useless rows stay faint.

Kerbl et al. 2023, section 5.2: rows with a use recover within some hundred steps, floaters
close to the cameras do not, and are pruned.
"""

from __future__ import annotations

from gsfw.core.model import DensifiableModel
from gsfw.core.refiner import RESET, RefineContext, Refinement, Refiner


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

    def refine(self, context: RefineContext) -> Refinement:
        """Lower opacities if a reset is due; moments of Adam restart at zero."""
        due = context.done < self._stop and context.done % self._every == 0
        if not due or not context.limits.may_grow or context.limits.hold:
            return {}
        assert isinstance(context.model, DensifiableModel)
        changed = context.model.change_opacities_(lambda values: values.clamp_max(self._opacity))
        context.table.reset_columns(changed)
        return {RESET: len(context.table)}
