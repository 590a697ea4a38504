"""Costs: Gaussians and memory that a block, or the whole scene, will need, about."""

from __future__ import annotations

import re
from dataclasses import dataclass

from gsfw.core.errors import ConfigError
from gsfw.core.training_memory import USUAL_ROW, TrainingMemory
from gsfw.planning.costs import GAUSSIANS_PER_PIXEL

UNITS = {"KB": 1e-3, "MB": 1.0, "GB": 1e3, "TB": 1e6}


@dataclass(frozen=True)
class Costs:
    """The needs of a part of a scene."""

    gaussians: int
    memory_mb: float


@dataclass(frozen=True)
class CostRule:
    """Turns views and points into costs."""

    pixels: int
    """Pixels of a view at the size of training, as a median."""
    views_per_point: float
    """Views that see a point: so many show the same surface."""
    all_points: int
    """Points of the data set."""
    cache_mb: int
    """Limit of decoded images."""

    def of(self, views: int, points: int) -> Costs:
        """Costs of training these.

        A view resolves ``GAUSSIANS_PER_PIXEL``, and a surface is in ``views_per_point`` views;
        there are never fewer Gaussians than points to start from.

        Args:
            views: number of training views.
            points: points to start from.
        """
        surface = max(1.0, views / max(self.views_per_point, 1.0))
        gaussians = max(points, round(GAUSSIANS_PER_PIXEL * self.pixels * surface))
        images = min(views * self.pixels * 3 / 1e6, self.cache_mb)
        need = TrainingMemory(gaussians, USUAL_ROW, self.all_points, self.pixels, 1e6 * images)
        return Costs(gaussians, need.total / 1e6)


def megabytes(text: str) -> float:
    """The number of megabytes (1e6 bytes) that "8GB" or "500MB" says.

    Raises:
        ConfigError: it says none.
    """
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([KMGT]B)\s*", text.upper())
    if not found or float(found[1]) <= 0:
        raise ConfigError(
            f"memory={text}: expected a size such as 8GB or 500MB.",
            "Give the memory that one training may take.",
        )
    return float(found[1]) * UNITS[found[2]]
