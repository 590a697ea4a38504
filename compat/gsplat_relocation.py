"""Relocation as in gsplat 1.6, whose ``MCMCStrategy`` calls it."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.api import coincident_copies

OPACITY_MAX = 1.0 - torch.finfo(torch.float32).eps
"""Upper bound of new opacities, so that their logits are finite."""


@torch.no_grad()
def compute_relocation(
    opacities: Float[Tensor, " r"],
    scales: Float[Tensor, "r 3"],
    ratios: Int[Tensor, " r"],
    binoms: Float[Tensor, "m m"],
    min_opacity: float = 0.005,
) -> tuple[Float[Tensor, " r"], Float[Tensor, "r 3"]]:
    """Opacities and scales of ``ratios`` coincident copies that render together as one did.

    Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain Monte Carlo", equation 9, where
    gsplat lifts the new opacity to ``min_opacity`` before it computes the scale.

    Args:
        opacities: in (0, 1).
        scales: standard deviations, in scene units.
        ratios: numbers of copies, the old one included; at least 1.
        binoms: square; its side is the largest number of copies, its values are not read.
        min_opacity: lower bound of new opacities.
    """
    counts = ratios.clamp(1, len(binoms))
    old = opacities.double()
    # The opacity whose copies have min_opacity; the sum of equation 9 depends on theirs alone.
    lifted = torch.maximum(old, 1 - (1 - min_opacity) ** counts.double())
    logits, factors = coincident_copies(lifted.logit(), counts)
    new = torch.sigmoid(logits).clamp_max(OPACITY_MAX)
    return new.to(opacities.dtype), (scales * (factors * old / lifted)[:, None]).to(scales.dtype)
