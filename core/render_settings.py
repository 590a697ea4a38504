"""RenderSettings: how to draw, and what to return besides the colours."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from jaxtyping import Float
from torch import Tensor

from gsfw.core.capabilities import Feature, Needs
from gsfw.core.numerics import DEFAULT, FAR, NEAR, NumericsProfile


class Depth(Enum):
    """Which depth image to draw."""

    NONE = "none"
    EXPECTED = "expected"
    """Sum of weight times view depth, divided by the sum of weights; 0 where nothing is drawn."""
    ACCUMULATED = "accumulated"
    """Sum of weight times view depth."""


class Statistic(Enum):
    """A per-splat quantity measured on the way; see ``RenderStatistics``."""

    SCREEN_GRADIENT = "screen gradient"
    ABSGRAD = "absgrad"
    CONTRIBUTION = "contribution"


class Validation(Enum):
    """How much is checked before drawing."""

    FULL = "full"
    """Every tensor finite and in range, besides what CHEAP checks."""
    CHEAP = "cheap"
    """Shapes, dtypes and devices: no look at the values, no synchronisation."""


STATISTIC_FEATURES = {
    Statistic.SCREEN_GRADIENT: Feature.SCREEN_GRADIENT,
    Statistic.ABSGRAD: Feature.ABSGRAD,
    Statistic.CONTRIBUTION: Feature.CONTRIBUTION,
}


@dataclass(frozen=True)
class RenderSettings:
    """How to draw, and what to return besides the colours."""

    background: Float[Tensor, " d"] | None = None
    """Colour behind everything, one value per channel; ``None`` for zeros."""
    near: float = NEAR
    """Splats whose view depth is below this are not drawn; scene units."""
    far: float = FAR
    """Splats whose view depth is above this are not drawn; scene units."""
    antialias: bool = False
    """Scale opacity by how much the dilation widens a splat (Mip-Splatting, Yu et al. 2024)."""
    depth: Depth = Depth.NONE
    statistics: frozenset[Statistic] = field(default_factory=frozenset)
    """What to measure; the gradient ones are written when ``backward`` runs."""
    contribution_weights: Float[Tensor, "c h w 1"] | None = None
    """Weight of each pixel in ``Statistic.CONTRIBUTION``, such as a mask or an error image; any
    finite number, without gradient. ``None`` for ones."""
    profile: NumericsProfile = DEFAULT
    validation: Validation = Validation.FULL

    def needs(self) -> Needs:
        """What these settings ask of a rasterizer."""
        features = {STATISTIC_FEATURES[statistic] for statistic in self.statistics}
        if self.antialias:
            features.add(Feature.ANTIALIAS)
        if self.depth is not Depth.NONE:
            features.add(Feature.DEPTH)
        if self.contribution_weights is not None:
            features.add(Feature.WEIGHTED_CONTRIBUTION)
        return Needs(features=frozenset(features))
