"""Presence: temporal weights of Gaussians, within the visible times [0, 1]."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Float64
from torch import Tensor


@dataclass(frozen=True)
class Presence:
    """Temporal weights exp(-(t - center)^2 / (2 variance)) over a sequence."""

    centers: Float[Tensor, " n"]
    variances: Float[Tensor, " n"]

    def peaks(self) -> Float[Tensor, " n"]:
        """The largest weight in [0, 1]; below 1 for centres outside."""
        outside = self.centers - self.centers.clamp(0.0, 1.0)
        return torch.exp(-0.5 * outside.square() / self.variances)

    def means(self) -> Float[Tensor, " n"]:
        """The mean weight over [0, 1]: 1 for rows that are always present."""
        low, high, width = self._ends()
        area = torch.special.erf(high) - torch.special.erf(low)
        return (0.5 * math.sqrt(math.pi) * width * area).to(self.centers)

    def draw(self, generator: torch.Generator) -> Float[Tensor, " n"]:
        """Sample a time in [0, 1] for each row, in proportion to its weight there.

        It is the nearest end for rows that are never present.
        """
        low, high, width = self._ends()
        low, high = torch.special.erf(low), torch.special.erf(high)
        device = self.centers.device
        uniform = torch.rand(len(width), generator=generator, device=device).double()
        drawn = self.centers + width * torch.special.erfinv(low + (high - low) * uniform)
        return torch.where(high > low, drawn, self.centers).clamp(0.0, 1.0).to(self.centers)

    def _ends(
        self,
    ) -> tuple[Float64[Tensor, " n"], Float64[Tensor, " n"], Float64[Tensor, " n"]]:
        """Distances of 0 and 1 from each centre, in widths, which are sqrt(2) deviations."""
        centers, width = self.centers.double(), (2.0 * self.variances.double()).sqrt()
        return -centers / width, (1.0 - centers) / width, width
