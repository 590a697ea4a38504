"""RenderOutput: the images and statistics that a rasterizer returns."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.render_settings import Statistic


@dataclass(frozen=True)
class RenderStatistics:
    """Values per camera and splat, in the order of the splats (``Splats.rows`` maps to the model).

    The forward pass returns the gradient statistics as zeros; backward fills them in place.
    Density strategies read these tensors, never the ``.grad`` of intermediate ones.
    """

    visible: Bool[Tensor, "c n"]
    """True where the splat can reach a pixel: in front, in the image, opaque enough."""
    radii: Float[Tensor, "c n"]
    """Half of the larger side of the splat's exact bounding box, in pixels; 0 where invisible."""
    screen_gradient: Float[Tensor, "c n"] | None = None
    """|dL / d centre| with the centre in NDC: pixel gradients times (width / 2, height / 2)."""
    absgrad: Float[Tensor, "c n"] | None = None
    """The same with each pixel's absolute gradient summed instead (Ye et al. 2024, AbsGS)."""
    contribution: Float[Tensor, "c n"] | None = None
    """Sum over pixels of alpha times transmittance, each times the pixel's weight in
    ``RenderSettings.contribution_weights``; written by the forward pass."""

    @staticmethod
    def zeros(
        means: Float[Tensor, "n 3"], cameras: int, wanted: frozenset[Statistic]
    ) -> RenderStatistics:
        """Zeros, with tensors for the ``wanted`` statistics."""
        shape = (cameras, len(means))

        def room(statistic: Statistic) -> Tensor | None:
            return means.new_zeros(shape) if statistic in wanted else None

        return RenderStatistics(
            visible=means.new_zeros(shape, dtype=torch.bool),
            radii=means.new_zeros(shape),
            screen_gradient=room(Statistic.SCREEN_GRADIENT),
            absgrad=room(Statistic.ABSGRAD),
            contribution=room(Statistic.CONTRIBUTION),
        )

    def where(self, finite: Bool[Tensor, ""]) -> RenderStatistics:
        """The same statistics, or zeros if ``finite`` is false; no synchronisation."""
        if finite.is_cpu and bool(finite):  # The host knows it without waiting.
            return self

        def gate(values: Tensor | None) -> Tensor | None:
            return None if values is None else torch.where(finite, values, 0.0)

        return RenderStatistics(
            visible=self.visible & finite,
            radii=torch.where(finite, self.radii, 0.0),
            screen_gradient=gate(self.screen_gradient),
            absgrad=gate(self.absgrad),
            contribution=gate(self.contribution),
        )


@dataclass(frozen=True)
class RenderOutput:
    """Images of ``c`` cameras: ``h`` by ``w`` pixels with ``d`` channels."""

    color: Float[Tensor, "c h w d"]
    """Colour, composited over the background; not clamped."""
    alpha: Float[Tensor, "c h w 1"]
    """1 - remaining transmittance; 0 where there is no splat."""
    statistics: RenderStatistics
    """Values per camera and splat."""
    depth: Float[Tensor, "c h w 1"] | None = None
    """Depth in scene units; ``None`` when not requested."""
    extra: Float[Tensor, "c h w e"] | None = None
    """The splats' extra channels over background 0; ``None`` when they have none."""
