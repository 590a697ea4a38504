"""Strategy none: the rows do not change."""

from __future__ import annotations

from dataclasses import dataclass

from gsfw.core.config import StrategyConfig
from gsfw.core.refiner import Refiner
from gsfw.core.scene import Scene


@dataclass
class NoneConfig(StrategyConfig):
    """No density control; works with any model."""

    def refiners(self, scene: Scene) -> tuple[Refiner, ...]:
        """No refiners."""
        return ()
