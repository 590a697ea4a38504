"""Polynomial motion: displacement at some time from the temporal centre.

Li et al. 2024, polynomial motion, without the constant term: the position at the centre.
"""

from __future__ import annotations

from math import comb

import torch
from jaxtyping import Float
from torch import Tensor


def displacement(
    coefficients: Float[Tensor, "n k 3"], elapsed: Float[Tensor, " n"]
) -> Float[Tensor, "n 3"]:
    """Sum over i of the i-th coefficient, counted from 1, times ``elapsed`` to the power of i."""
    total = torch.zeros_like(coefficients[:, 0])
    for coefficient in reversed(coefficients.unbind(1)):
        total = (total + coefficient) * elapsed[:, None]
    return total


def recentered(
    coefficients: Float[Tensor, "n k 3"], shift: Float[Tensor, " n"]
) -> Float[Tensor, "n k 3"]:
    """Coefficients of the same path about a centre that lies ``shift`` later.

    The position there is the old one plus ``displacement(coefficients, shift)``.
    """
    order = coefficients.shape[1]
    powers = torch.stack([shift**power for power in range(order)], dim=1)
    moved = [
        sum(
            comb(higher, lower) * powers[:, higher - lower, None] * coefficients[:, higher - 1]
            for higher in range(lower, order + 1)
        )
        for lower in range(1, order + 1)
    ]
    return torch.stack(moved, dim=1)  # type: ignore[arg-type]
