"""Tally: which Gaussians were seen where, and by how much, added up tile after tile."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.render_output import RenderStatistics


@dataclass(frozen=True)
class Tally:
    """Of one camera, with a row per splat."""

    contributions: Float[Tensor, " n"]
    lowest: Float[Tensor, "n 2"]
    """Of the pixels that it reaches, whose centres these are; infinite where it reaches none."""
    highest: Float[Tensor, "n 2"]

    @staticmethod
    def empty(means: Float[Tensor, "n 3"]) -> Tally:
        """Nothing seen yet."""
        return Tally(
            means.new_zeros(len(means)),
            means.new_full((len(means), 2), torch.inf),
            means.new_full((len(means), 2), -torch.inf),
        )

    def add(
        self,
        rows: Int[Tensor, " m"],
        contributions: Float[Tensor, " m"],
        touched: Bool[Tensor, "r m"],
        pixels: Float[Tensor, "r 2"],
    ) -> None:
        """Add what some rays, of these pixels, saw of some splats."""
        self.contributions[rows] += contributions
        places, inside = pixels[:, None], touched[:, :, None]
        lowest = torch.where(inside, places, torch.inf).amin(0)
        highest = torch.where(inside, places, -torch.inf).amax(0)
        self.lowest[rows] = torch.minimum(self.lowest[rows], lowest)
        self.highest[rows] = torch.maximum(self.highest[rows], highest)

    def record(self, statistics: RenderStatistics, camera: int) -> None:
        """Write the statistics of a camera."""
        sides = (self.highest - self.lowest + 1).amax(1)
        visible = sides > 0
        statistics.visible[camera] = visible
        statistics.radii[camera] = torch.where(visible, 0.5 * sides, 0.0)
        if statistics.contribution is not None:
            statistics.contribution[camera] = self.contributions
