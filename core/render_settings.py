"""RenderSettings: the conventions of a render, and the outputs besides colour."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from jaxtyping import Float
from torch import Tensor

from gsfw.core.capabilities import Feature, Needs
from gsfw.core.numerics import DEFAULT, FAR, NEAR, NumericsProfile


class Depth(Enum):
    """Kind of depth image."""

    NONE = "none"
    """No depth image."""
    EXPECTED = "expected"
    """Sum of weight times view depth, divided by the sum of weights; 0 where there is no splat."""
    ACCUMULATED = "accumulated"
    """Sum of weight times view depth."""


class Statistic(Enum):
    """Per-splat quantity that is measured during rendering; see ``RenderStatistics``."""

    SCREEN_GRADIENT = "screen gradient"
    """Gradient of the loss for the centre in the image; the backward pass writes it."""
    ABSGRAD = "absgrad"
    """The same, with the absolute gradient of each pixel; the backward pass writes it."""
    CONTRIBUTION = "contribution"
    """Sum of alpha times transmittance over the pixels; the forward pass writes it."""


class Validation(Enum):
    """Amount of input checks before rendering."""

    FULL = "full"
    """CHEAP, and every tensor is finite and in range."""
    CHEAP = "cheap"
    """Shapes, dtypes and devices, but no values; no synchronisation."""


STATISTIC_FEATURES = {
    Statistic.SCREEN_GRADIENT: Feature.SCREEN_GRADIENT,
    Statistic.ABSGRAD: Feature.ABSGRAD,
    Statistic.CONTRIBUTION: Feature.CONTRIBUTION,
}


@dataclass(frozen=True)
class RenderSettings:
    """The conventions of a render, and the outputs besides colour."""

    background: Float[Tensor, " d"] | None = None
    """Colour behind everything, one value per channel; ``None`` for zeros."""
    near: float = NEAR
    """Near plane: splats with a smaller view depth are skipped; scene units."""
    far: float = FAR
    """Far plane: splats with a larger view depth are skipped; scene units."""
    antialias: bool = False
    """Reduce opacities by the area that dilation adds (Mip-Splatting, Yu et al. 2024)."""
    depth: Depth = Depth.NONE
    """Depth image to render besides colour."""
    statistics: frozenset[Statistic] = field(default_factory=frozenset)
    """Statistics to measure; the backward pass writes the gradient ones."""
    contribution_weights: Float[Tensor, "c h w 1"] | None = None
    """Weight of each pixel in ``Statistic.CONTRIBUTION``, such as a mask or an error image; any
    finite number, without gradient. ``None`` for ones."""
    profile: NumericsProfile = DEFAULT
    """Cut-offs and constants to render with."""
    validation: Validation = Validation.FULL
    """Checks of the inputs; the training loop makes the cheap ones only."""

    def needs(self) -> Needs:
        """The needs of these settings from a rasterizer."""
        features = {STATISTIC_FEATURES[statistic] for statistic in self.statistics}
        if self.antialias:
            features.add(Feature.ANTIALIAS)
        if self.depth is not Depth.NONE:
            features.add(Feature.DEPTH)
        if self.contribution_weights is not None:
            features.add(Feature.WEIGHTED_CONTRIBUTION)
        return Needs(features=frozenset(features))
