"""Relocation: opacity and scale of coincident copies that render together as one Gaussian did.

Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain Monte Carlo", equation 9. Its double
sum has alternating binomial coefficients and loses every digit for many copies of an opaque
Gaussian. With 1 / sqrt(k + 1) written as a Gaussian integral the sum collapses into

    2 / sqrt(pi) * integral over u >= 0 of 1 - (1 - o' exp(-u^2))^N,

the accumulated alpha of N copies of opacity o' along a line through their centre, which has only
positive terms. The trapezoidal rule evaluates it to machine precision, for any N (the released code
stops at 51 copies). Unlike the released code we do not lift the opacity to the pruning threshold.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import logsigmoid

NODE_SPACING = 0.125
"""Spacing of the trapezoidal rule, whose error falls like exp(-2 pi a / spacing): below 1e-14."""
NUM_NODES = 60
"""The last node is at 7.4, where exp(-u^2) is 2e-24: negligible for up to 1e6 copies."""
MAX_LOGIT = 40.0
"""Opacity 1 - 4e-18; a larger logit changes no image."""


def coincident_copies(
    logits: Float[Tensor, " r"], counts: Int[Tensor, " r"]
) -> tuple[Float[Tensor, " r"], Float[Tensor, " r"]]:
    """New opacity logits, and factors for the scales, both float64.

    Args:
        logits: logit of the opacity of each row.
        counts: number of copies, the row itself included; at least 1.
    """
    logits = logits.double().clamp(-MAX_LOGIT, MAX_LOGIT)
    # Opacity o of one is 1 - (1 - o') ** count of all: exact in the logarithm of 1 - o.
    log_transmittance = logsigmoid(-logits) / counts
    opacities = -torch.expm1(log_transmittance)
    seen = torch.zeros_like(opacities)
    for node in range(NUM_NODES):
        falloff = math.exp(-((node * NODE_SPACING) ** 2))
        alpha = -torch.expm1(counts * torch.log1p(-opacities * falloff))
        seen += alpha * (0.5 if node == 0 else 1.0)
    seen *= NODE_SPACING * 2.0 / math.sqrt(math.pi)
    return opacities.log() - log_transmittance, torch.sigmoid(logits) / seen
