"""Strategy none: the rows stay as they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch

from gsfw.core.config import StrategyConfig
from gsfw.core.context import StepContext
from gsfw.core.model import PrimitiveModel
from gsfw.core.render_output import RenderStatistics
from gsfw.core.scene import Scene
from gsfw.core.strategy import DensityStrategy, Refinement
from gsfw.core.table import SplatTable


@dataclass
class NoneConfig(StrategyConfig):
    """No density control."""

    def build(self, scene: Scene) -> DensityStrategy:
        """The strategy."""
        return NoDensityControl()


class NoDensityControl(DensityStrategy):
    """Neither adds nor moves nor removes."""

    def observe(
        self, context: StepContext, statistics: RenderStatistics, model: PrimitiveModel
    ) -> None:
        """Nothing to note."""

    def refine(
        self, step: int, table: SplatTable, model: PrimitiveModel, generator: torch.Generator
    ) -> Refinement:
        """Nothing to do."""
        return {}

    def state_dict(self) -> dict[str, Any]:
        """Nothing to keep."""
        return {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Nothing to restore."""
