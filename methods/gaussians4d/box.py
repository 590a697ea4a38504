"""SpaceBox: the box of the grids' cells, and the contraction of space into it.

Wu et al. 2024 use the bounding box of the initial points and give everything outside the features
of its border. One stray point makes that box huge, and everything outside moves as one. Here the
box holds nearly all points, and space beyond it is contracted, axis by axis, into a thin shell, as
in Barron et al. 2022 ("Mip-NeRF 360", equation 10): smoothly and injectively.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

SHELL = 0.1
"""Thickness of the shell of all space beyond the box, in halves of the box."""
STRAY = 0.01
"""Fraction of the points that may lie beyond the box at either end of an axis (no margin)."""
MARGIN = 0.1
"""Margin on every side, in halves of the box, for motion."""
FLATTEST = 0.1
"""Least side, relative to the longest: points of a wall have no depth of their own."""


class SpaceBox(nn.Module):
    """An axis-aligned box, and the contraction of space around it."""

    center: Tensor
    reach: Tensor

    def __init__(self, points: Float[Tensor, "n 3"], extent: float) -> None:
        """Enclose nearly all of ``points``; without any, a cube of half side ``extent`` at 0."""
        super().__init__()
        low, high = np.full(3, -extent), np.full(3, extent)
        if len(points):
            low, high = np.quantile(points.double().numpy(), [STRAY, 1 - STRAY], axis=0)
        half = (1 + MARGIN) * (high - low) / 2
        half = np.maximum(half, FLATTEST * half.max()) if half.max() > 0 else extent
        self.register_buffer("center", torch.from_numpy((low + high) / 2).to(points))
        self.register_buffer("reach", torch.from_numpy(half + np.zeros(3)).to(points))

    @property
    def size(self) -> Float[Tensor, ""]:
        """Half of the longest side, in scene units."""
        return self.reach.amax()

    def forward(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Coordinates in [-1, 1]: proportional to the position inside, contracted beyond the box.

        Value and first derivative are continuous everywhere.
        """
        scaled = (points - self.center) / self.reach
        beyond = (scaled.abs() - 1).clamp_min(0) / SHELL
        contracted = scaled.sign() * (1 + SHELL * (1 - 1 / (1 + beyond)))
        return torch.where(scaled.abs() <= 1, scaled, contracted) / (1 + SHELL)
