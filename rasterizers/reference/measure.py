"""Measure: the statistics of one camera's splats, written while the image is painted."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.render_output import RenderStatistics


@dataclass(frozen=True)
class Measurements:
    """Where the statistics of one camera go; ``None`` for those that were not asked for."""

    rows: Int[Tensor, " m"]
    """The splat of each ellipse."""
    half_size: Float[Tensor, " 2"]
    """Half the image's sides: pixels per unit of NDC."""
    screen_gradient: Float[Tensor, " n"] | None
    absgrad: Float[Tensor, " n"] | None
    contribution: Float[Tensor, " n"] | None
    pixel_weights: Float[Tensor, "tiles p"] | None
    """Of the pixels in ``contribution``; ``None`` for ones."""

    @staticmethod
    def of(
        statistics: RenderStatistics,
        index: int,
        rows: Int[Tensor, " m"],
        camera: Cameras,
        pixel_weights: Float[Tensor, "tiles p"] | None,
    ) -> Measurements:
        """The rows of ``statistics`` that belong to camera ``index``."""

        def row(tensor: Tensor | None) -> Tensor | None:
            return None if tensor is None else tensor[index]

        return Measurements(
            rows=rows,
            half_size=0.5 * statistics.radii.new_tensor([camera.width, camera.height]),
            screen_gradient=row(statistics.screen_gradient),
            absgrad=row(statistics.absgrad),
            contribution=row(statistics.contribution),
            pixel_weights=pixel_weights,
        )

    def record_gradients(
        self, centres: Float[Tensor, "m 2"], absolute: Float[Tensor, "m 2"] | None
    ) -> None:
        """Keep the pixel gradients of the ellipses' centres, and their sums of magnitudes."""
        if self.screen_gradient is not None:
            self.screen_gradient[self.rows] = (centres * self.half_size).norm(dim=1)
        if self.absgrad is not None and absolute is not None:
            self.absgrad[self.rows] = (absolute * self.half_size).norm(dim=1)

    def sum_weights(
        self, tiles: Int[Tensor, " t"], weights: Float[Tensor, "t s p"]
    ) -> Float[Tensor, "t s"]:
        """Sum blending weights over the pixels of ``tiles``, each times the pixel's weight."""
        if self.pixel_weights is not None:
            weights = weights * self.pixel_weights[tiles, None]
        return weights.sum(2)

    def record_contribution(self, weights: Float[Tensor, " m"]) -> None:
        """Keep each ellipse's sum of weights."""
        if self.contribution is not None:
            self.contribution[self.rows] = weights
