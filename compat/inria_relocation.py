"""Relocation of 3DGS-MCMC, as its fork of diff-gaussian-rasterization exports it."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.api import coincident_copies


@torch.no_grad()
def compute_relocation(
    opacity_old: Float[Tensor, " r"],
    scale_old: Float[Tensor, "r 3"],
    N: Int[Tensor, " r"],
    binoms: Float[Tensor, "m m"],
    n_max: int,
) -> tuple[Float[Tensor, " r"], Float[Tensor, "r 3"]]:
    """Opacities and scales of ``N`` coincident copies that render together as one did.

    Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain Monte Carlo", equation 9.

    Args:
        opacity_old: in (0, 1).
        scale_old: standard deviations, in scene units.
        N: numbers of copies, the old one included; at least 1.
        binoms: not read; the integral form of the equation needs no binomial coefficients.
        n_max: not read; any number of copies is computed.
    """
    logits, factors = coincident_copies(opacity_old.double().logit(), N)
    return (
        torch.sigmoid(logits).to(opacity_old.dtype),
        (scale_old * factors[:, None]).to(scale_old.dtype),
    )
