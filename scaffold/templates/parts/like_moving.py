"""Method my-part: BASE with one more trained column.

Each Gaussian has a brightness of its own, which is rendered as an extra channel and fitted to that
of the photos. Density control, the optimizer, checkpoints and model files include the column.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from gsfw.api import (
    BaseConfig,
    BaseMethod,
    Cameras,
    Column,
    Feature,
    LearningRate,
    Method,
    Needs,
    Scene,
    Splats,
    StaticGaussians,
    StaticGaussiansMethod,
    StepContext,
    ViewContext,
    masked_mean,
    number,
)
from torch import Tensor


@dataclass
class MyPartConfig(BaseConfig):
    """Settings of method my-part, besides those of BASE."""

    brightness_weight: float = number(0.1, at_least=0, at_most=100)
    """Weight of the brightness in the loss."""
    brightness_lr: float = number(0.01, above=0, at_most=1)
    """Learning rate of the brightness."""

    def needs(self) -> Needs:
        """The needs of BASE, and the extra channel of the brightness."""
        return super().needs() | Needs(features=frozenset({Feature.EXTRA}), extra_channels=1)

    def build(self) -> Method:
        """Build the method."""
        return MyPart(self)


class MyPartGaussians(StaticGaussians):
    """Canonical Gaussians with a brightness, which does not change with time."""

    def splats(self, time: Tensor | None = None, cameras: Cameras | None = None) -> Splats:
        """The activated Gaussians, with their brightness as an extra channel."""
        brightness = self.columns()["brightness"].values
        return replace(super().splats(time, cameras), extra=brightness)


class MyPartCanonical(StaticGaussiansMethod):
    """Makes the canonical Gaussians, which have all that does not change with time."""

    model_class = MyPartGaussians
    config: MyPartConfig

    def extra_columns(self, scene: Scene, count: int) -> Mapping[str, Column]:
        """The brightness of ``count`` rows, [count, 1]: medium at first."""
        start = scene.point_colors.new_full((count, 1), 0.5)
        return {"brightness": Column(start, LearningRate(self.config.brightness_lr))}


class MyPart(BaseMethod):
    """Trains the brightness beside everything else."""

    canonical_method = MyPartCanonical

    def __init__(self, config: MyPartConfig) -> None:
        super().__init__(config)
        self._weight = config.brightness_weight

    def losses(self, context: StepContext) -> Mapping[str, Tensor]:
        """The losses of BASE, and the mean error of the brightness."""
        error = _error(context)
        term = self._weight * masked_mean(error, context.batch.valid)
        return {**super().losses(context), "brightness": term}

    def view_metrics(self, context: ViewContext) -> Mapping[str, float]:
        """The mean error of the brightness in a held-out view."""
        error = masked_mean(_error(context), context.batch.valid)
        return {"brightness_error": float(error)}


def _error(context: StepContext | ViewContext) -> Tensor:
    """Absolute error of the brightness over black, as extra channels are rendered, [c, h, w, 1]."""
    assert context.rendered.extra is not None  # By ``splats``.
    black = context.target.new_zeros(3)
    wanted = context.batch.target(black).mean(dim=3, keepdim=True)
    return (context.rendered.extra - wanted).abs()
