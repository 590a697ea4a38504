"""Method my-part: isotropic Gaussians of one colour.

Model, losses and learning rates are its own. The model has no rows that density control could split
or clone, so it trains with strategy=none. For one that grows, derive from ``DensifiableModel``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from gsfw.api import (
    Cameras,
    Column,
    LearningRate,
    Method,
    MethodConfig,
    Operators,
    PrimitiveModel,
    Scene,
    Splats,
    StepContext,
    masked_mean,
    number,
)
from torch import Tensor


@dataclass
class MyPartConfig(MethodConfig):
    """Settings of method my-part, besides those that every run has."""

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {"default": {"strategy": "none"}}

    count: int = number(5000, at_least=1)
    """Number of Gaussians."""
    rate: float = number(0.02, above=0, at_most=1)
    """Learning rate of colours, sizes and opacities; that of positions is a tenth, in extents."""
    shrink: float = number(0.01, at_least=0, at_most=1)
    """Weight of the mean size, in extents, in the loss."""

    def build(self) -> Method:
        """Build the method."""
        return MyPart(self)


class MyPartModel(PrimitiveModel):
    """Spheres: each has a position, a colour, a size and an opacity."""

    def __init__(
        self,
        means: Tensor,
        colors: Tensor,
        size: float,
        config: MyPartConfig,
    ) -> None:
        """Place spheres.

        Args:
            means: positions, [n, 3], in scene units.
            colors: colours in [0, 1], [n, 3].
            size: standard deviation of all, in scene units.
            config: the learning rates.
        """
        super().__init__()
        extent = 50 * size
        others = LearningRate(config.rate)
        moving = LearningRate(
            0.1 * config.rate * extent, 0.001 * config.rate * extent, config.steps
        )
        self.means = Column(means, moving)
        self.colors = Column(colors, others)
        self.log_sizes = Column(means.new_full((len(means),), size).log(), others)
        self.logits = Column(means.new_zeros(len(means)), others)

    def columns(self) -> Mapping[str, Column]:
        """The four quantities of each sphere."""
        names = ("means", "colors", "log_sizes", "logits")
        return {name: getattr(self, name) for name in names}

    def splats(self, time: Tensor | None = None, cameras: Cameras | None = None) -> Splats:
        """The spheres, activated; the same at every time and from every camera."""
        means, sizes = self.means.values, self.log_sizes.values.exp()
        quats = torch.eye(1, 4, dtype=means.dtype, device=means.device).expand(len(means), 4)
        scales = sizes[:, None].expand(-1, 3)
        return Splats(means, self.logits.values.sigmoid(), self.colors.values, quats, scales)


class MyPart(Method):
    """Trains spheres on the squared colour difference."""

    def __init__(self, config: MyPartConfig) -> None:
        self._config = config

    def build_model(
        self,
        scene: Scene,
        operators: Operators,
        generator: torch.Generator,
        initial: Splats | None,
    ) -> MyPartModel:
        """Spheres at points of the capture, or at random among the cameras."""
        count = self._config.count
        if len(scene.points) > 0:
            chosen = torch.randint(len(scene.points), (count,), generator=generator)
            means, colors = scene.points[chosen], scene.point_colors[chosen]
        else:
            places = scene.extent * torch.randn(count, 3, generator=generator)
            means, colors = scene.camera_centers.mean(dim=0) + places, torch.full((count, 3), 0.5)
        return MyPartModel(means, colors, 0.02 * scene.extent, self._config)

    def losses(self, context: StepContext) -> Mapping[str, Tensor]:
        """The mean squared difference of the valid pixels, and the mean size."""
        squares = (context.rendered.color - context.target).square()
        scales = context.splats.scales
        assert scales is not None  # The model has no covariances.
        shrinking = self._config.shrink * scales.mean() / context.extent
        return {"squares": masked_mean(squares, context.batch.valid), "sizes": shrinking}
