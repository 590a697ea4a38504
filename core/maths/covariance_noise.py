"""Noise shaped by each Gaussian's covariance (Kheradmand et al. 2024, equation 8)."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.maths.rotations import matrices_rows_last

NOISE_SHARPNESS, NOISE_OPACITY = 100.0, 0.005
"""Opacity at which noise fades out: sigmoid(-100 (o - 0.005)). The text of Kheradmand et al. 2024
has t = 1 - 0.005 in equation 8; the released code and ours have 0.005, the pruning threshold."""


def noise_strengths(opacities: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Strength of the noise by opacity, from 0 to 1."""
    return torch.sigmoid(NOISE_SHARPNESS * (NOISE_OPACITY - opacities))


def shaped_noise(
    quats: Float[Tensor, "n 4"],
    log_scales: Float[Tensor, "n 3"],
    opacity_logits: Float[Tensor, " n"],
    noise: Float[Tensor, "n 3"],
    rate: float,
) -> Float[Tensor, "n 3"]:
    """Shifts of covariance Sigma^2, times ``rate`` and the strength, from normal ``noise``.

    Args:
        quats: rotations (wxyz) of any norm.
        log_scales: logarithms of the standard deviations along the axes of the Gaussians.
        opacity_logits: logits of the opacities.
        noise: independent standard normal numbers.
        rate: factor of all shifts.
    """
    strengths = noise_strengths(opacity_logits.sigmoid())
    variances = (2.0 * log_scales).exp()
    turned = matrices_rows_last(quats)
    along_axes = (turned * noise.T[:, None]).sum(0) * variances.T
    shaped = (turned * along_axes).sum(1)
    return (shaped * (rate * strengths)).T
