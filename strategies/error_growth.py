"""Growth by error: rows are added where several views show one, up to a given number.

A row is the more urgent, the larger the mean gradient of its screen position and the error that
several views agree on (``core.refinement.view_errors``): the two conditions of Ren et al. 2025
(FastGS), as one rank. In each round the most urgent rows are split, as many as lead to the number
that the schedule has for that step: it rises fast at first and ends at ``per_pixel``.

Differences from FastGS: no thresholds of gradients and of counts of bad pixels, which depend on
scene and image size; the errors of views that training renders anyway, in the last steps before a
round, instead of views rendered for it; small rows are split too, and none cloned; pruning by
contributions is that of ``strategy.budget``; and opacities are not reset.
``docs/results/growth-and-dense-start.md`` measures each of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Int
from torch import Tensor

from gsfw.core.capabilities import Feature, Needs
from gsfw.core.config import StrategyConfig
from gsfw.core.context import StepContext
from gsfw.core.errors import ConfigError
from gsfw.core.model import DensifiableModel, PrimitiveModel
from gsfw.core.ranges import number
from gsfw.core.refinement.view_errors import ViewErrors
from gsfw.core.refiner import RefineContext, Refinement, Refiner
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import Statistic
from gsfw.core.scene import Scene
from gsfw.core.step_settings import steps_field
from gsfw.strategies.rounds import COPIES, DensityRefiner, RefinementRounds


@dataclass
class ErrorGrowthConfig(StrategyConfig):
    """Settings of growth by error; steps are those of a run of 30,000."""

    per_pixel: float = number(0.8, above=0)
    """Gaussians at the end of growth, for each pixel of a training view that shows some."""
    max_gaussians: int = number(3_000_000, at_least=0)
    """No growth beyond this number (3 GB of parameters and optimizer state); 0: no limit."""
    early: float = number(2.0, at_least=1)
    """Speed of the growth at its start: 1 adds as many Gaussians in each round, 2 begins twice as
    fast and slows down."""
    agreeing_views: int = number(2, at_least=1)
    """Views that have to agree on the error of a Gaussian, of those that see it."""
    views: int = number(10, at_least=1)
    """Last steps before a round whose views are asked; each costs a further forward pass."""
    prune_opacity: float = number(0.005, at_least=0)
    """Rows below this opacity are removed."""
    refine_start: int = steps_field(1500, floor=50)
    """No refinement up to this step; before, most errors are those of unsettled rows."""
    refine_stop: int = steps_field(15_000)
    """No refinement from this step on."""
    refine_every: int = steps_field(500, at_least=1, floor=25)
    """Steps between refinements, in which gradients are gathered."""

    def needs(self) -> Needs:
        """Screen gradients, sums of errors over contributions, and rows that can be split."""
        features = {Feature.SCREEN_GRADIENT, Feature.WEIGHTED_CONTRIBUTION}
        return Needs(features=frozenset(features), densifiable=True)

    def check(self) -> None:
        """Check that no more views have to agree than are asked.

        Raises:
            ConfigError: ``agreeing_views`` exceeds ``views``.
        """
        if self.agreeing_views > self.views:
            raise ConfigError(
                f"strategy.agreeing_views={self.agreeing_views}: expected at most "
                f"strategy.views={self.views}, the views that are asked.",
                f"Give strategy.views={self.agreeing_views} or more, or a smaller "
                "strategy.agreeing_views.",
            )

    def refiners(self, scene: Scene) -> tuple[Refiner, ...]:
        """Growth by error."""
        rounds = RefinementRounds(self.refine_start, self.refine_every, self.refine_stop)
        return (ErrorGrowth(self, scene, rounds),)


class ErrorGrowth(DensityRefiner):
    """Adds rows where several views have errors; removes transparent ones."""

    name = "error"

    def __init__(self, config: ErrorGrowthConfig, scene: Scene, rounds: RefinementRounds) -> None:
        super().__init__(rounds)
        self._config = config
        known = scene.view_pixels > 0
        self._last = config.per_pixel * scene.view_pixels if known else config.max_gaussians
        self._errors: ViewErrors | None = None
        self._first: int | None = None
        self._may_grow = True

    def statistics(self, step: int) -> frozenset[Statistic]:
        """The screen gradient, while rows may be added later."""
        gathers = self._may_grow and step + 1 < self._config.refine_stop
        return frozenset({Statistic.SCREEN_GRADIENT} if gathers else ())

    def can_be_recorded(self, step: int) -> bool:
        """False in the last steps before a round, when the host counts views."""
        return not (self._may_grow and self._rounds.nears(step, self._config.views))

    def before_backward(self, context: StepContext, model: PrimitiveModel) -> None:
        """Gather the errors of views in the last steps before a round."""
        if self.can_be_recorded(context.step):
            return
        if self._errors is None:
            device = context.splats.means.device
            self._errors = ViewErrors(context.num_rows, self._config.agreeing_views, device)
        self._errors.add(context)

    def observe(
        self, context: StepContext, statistics: RenderStatistics, model: PrimitiveModel
    ) -> None:
        """Add up gradients by row."""
        self.gather(context, statistics, statistics.screen_gradient)

    def refine(self, context: RefineContext) -> Refinement:
        """Grow and prune every ``refine_every`` steps, unless another refiner prunes that step."""
        self._may_grow = context.limits.may_grow
        if context.done >= self._config.refine_stop:
            self.rows_edited()
        held = context.limits.hold or "pruned" in context.edits
        if held or not self._rounds.due(context.done):
            return {}
        table, model = context.table, context.model
        assert isinstance(model, DensifiableModel)
        split = self._most_urgent(self._missing_rows(context))
        self.rows_edited()
        if len(split):
            kept = torch.ones(len(table), dtype=torch.bool, device=table.device)
            kept[split] = False
            table.edit(kept, model.split_rows(split, COPIES, context.generator))
        pruned = self.prune(table, model, model.opacities() >= self._config.prune_opacity)
        return {"split": len(split), "pruned": pruned}

    def _missing_rows(self, context: RefineContext) -> int:
        """Number of rows to add in this round, within all limits."""
        rows, config = len(context.table), self._config
        if self._first is None:
            self._first = rows
        left = (1.0 - self._rounds.progress(context.done)) ** config.early
        number = self._last * (1.0 - left) + self._first * left
        wanted = max(round(number) - rows, 0)
        return context.limits.room(rows, wanted, config.max_gaussians)

    def _most_urgent(self, number: int) -> Int[Tensor, " r"]:
        """At most so many rows that have an error, the most urgent first."""
        if self._seen is None or self._errors is None:
            return torch.zeros(0, dtype=torch.long)
        urgency = self._seen.mean_gradient * self._errors.agreed
        ranked = urgency.argsort(descending=True, stable=True)[:number]
        return ranked[urgency[ranked] > 0]

    def rows_edited(self) -> None:
        """Drop the statistics after a change of rows."""
        super().rows_edited()
        self._errors = None

    def state_dict(self) -> dict[str, Any]:
        """Gradients and errors since the last change of rows, and the first number of rows."""
        errors = None if self._errors is None else self._errors.state_dict()
        own = {"errors": errors, "first": self._first, "may_grow": self._may_grow}
        return {**super().state_dict(), **own}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``."""
        super().load_state_dict(state)
        errors = state.get("errors")
        self._errors = None if errors is None else ViewErrors.restored(errors)
        self._first, self._may_grow = state.get("first"), state.get("may_grow", True)
