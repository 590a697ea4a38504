"""The refiners of a strategy and its budget, called as the trainer calls them."""

from typing import Any

import torch

from gsfw.core.config import StrategyConfig
from gsfw.core.model import PrimitiveModel
from gsfw.core.refinement.budget import with_budget
from gsfw.core.refinement.refiners import Refiners
from gsfw.core.refiner import GrowthLimits, RefineContext, Refiner
from gsfw.core.scene import Scene
from gsfw.core.table import SplatTable
from support.gaussians import toy_scene


class StrategyRun(Refiners):
    """The refiners of a strategy in a run of 100 steps."""

    def __init__(self, config: StrategyConfig, scene: Scene | None = None) -> None:
        super().__init__(with_budget(config, toy_scene() if scene is None else scene))

    def edit(
        self, step: int, table: SplatTable, model: PrimitiveModel, generator: torch.Generator
    ) -> dict[str, int]:
        """Let all refiners edit rows after a step; the edits by verb."""
        return dict(self.refine(step, 100, table, model, generator))

    def gathered(self) -> dict[str, Any]:
        """The sums by row of density control; empty when there are none."""
        state = self.state_dict()
        found = next((s["gathered"] for s in state.values() if "gathered" in s), {})
        assert isinstance(found, dict)
        return found


def refine(
    refiner: Refiner,
    step: int,
    table: SplatTable,
    model: PrimitiveModel,
    generator: torch.Generator | None = None,
) -> dict[str, int]:
    """Let a single refiner edit rows after a step; its edits by verb."""
    generator = torch.Generator().manual_seed(0) if generator is None else generator
    limits = GrowthLimits()
    return dict(
        refiner.refine(RefineContext(step, 100, table, model, generator, limits, False, {}))
    )
