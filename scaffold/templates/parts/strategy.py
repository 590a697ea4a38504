"""Strategy my-part: clones by the gradient, prunes by the opacity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from gsfw.api import (
    DensifiableModel,
    Feature,
    Needs,
    PrimitiveModel,
    RefineContext,
    Refinement,
    Refiner,
    RenderStatistics,
    RowStatistics,
    Scene,
    Statistic,
    StepContext,
    StrategyConfig,
    number,
    steps_field,
)


@dataclass
class MyPartConfig(StrategyConfig):
    """Settings of strategy my-part."""

    every: int = steps_field(100, at_least=1, floor=10)
    """Steps between rounds of cloning and pruning."""
    stop: int = steps_field(15_000)
    """No round from this step on."""
    grow_share: float = number(0.05, at_least=0, at_most=1)
    """Rows cloned in a round, relative to those there are: those with the largest gradients."""
    prune_opacity: float = number(0.005, at_least=0, below=1)
    """Rows below this opacity are removed."""
    max_gaussians: int = number(1_000_000, at_least=1)
    """No growth beyond this number."""

    def needs(self) -> Needs:
        """The gradient of screen positions, and a model with rows that can be cloned."""
        return Needs(features=frozenset({Feature.SCREEN_GRADIENT}), densifiable=True)

    def refiners(self, scene: Scene) -> tuple[Refiner, ...]:
        """The one refiner of this strategy."""
        return (MyPart(self),)


class MyPart(Refiner):
    """Clones and prunes in rounds, by the views since the last round."""

    name = "my-part"

    def __init__(self, config: MyPartConfig) -> None:
        self._config = config
        self._seen: RowStatistics | None = None

    def _due(self, done: int) -> bool:
        """True if there is a round after ``done`` steps."""
        return done < self._config.stop and done % self._config.every == 0

    def statistics(self, step: int) -> frozenset[Statistic]:
        """The screen gradient, as long as there are rounds."""
        going = step + 1 < self._config.stop
        return frozenset({Statistic.SCREEN_GRADIENT} if going else ())

    def growth_due(self, step: int) -> bool:
        """True before each round."""
        return self._due(step + 1)

    @property
    def growth_ends(self) -> int:
        """The end of the rounds."""
        return self._config.stop

    def observe(
        self, context: StepContext, statistics: RenderStatistics, model: PrimitiveModel
    ) -> None:
        """Add up the gradients of a batch, row by row."""
        if statistics.screen_gradient is None:
            return
        if self._seen is None:
            self._seen = RowStatistics(context.num_rows, statistics.screen_gradient.device)
        self._seen.add(context, statistics, statistics.screen_gradient)

    def refine(self, context: RefineContext) -> Refinement:
        """Clone and prune in a round; the limits of a budget come first."""
        if not self._due(context.done) or context.limits.hold or self._seen is None:
            return {}
        seen, self._seen = self._seen, None
        table, model = context.table, context.model
        assert isinstance(model, DensifiableModel)  # By ``needs``.
        wanted = int(self._config.grow_share * len(table))
        count = context.limits.room(len(table), wanted, self._config.max_gaussians)
        rows = seen.mean_gradient.argsort(descending=True, stable=True)[:count]
        if count > 0:
            table.append(model.clone_rows(rows, context.generator))
        return {"cloned": count, "pruned": self._prune(context, model)}

    def _prune(self, context: RefineContext, model: DensifiableModel) -> int:
        """Remove transparent rows; the most opaque one stays in any case."""
        opacities = model.opacities()
        kept = opacities >= self._config.prune_opacity
        kept[opacities.argmax()] = True
        pruned = len(kept) - int(kept.sum())
        if pruned > 0:
            context.table.keep(kept)
        return pruned

    def rows_edited(self) -> None:
        """Drop the sums: their rows are others now."""
        self._seen = None

    def state_dict(self) -> dict[str, Any]:
        """The sums since the last round, for checkpoints."""
        return {} if self._seen is None else {"seen": self._seen.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``."""
        seen = state.get("seen")
        device = torch.device("cpu") if seen is None else seen["views"].device
        self._seen = None if seen is None else RowStatistics.restored(seen, device)
