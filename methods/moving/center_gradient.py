"""Gradients of temporal centres, for strategies that grow rows by them."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.column import Column


def center_gradients(centers: Column) -> Float[Tensor, " n"] | None:
    """|dL / d centre| of each row: 0 for rows without a centre; ``None`` before any step.

    Args:
        centers: temporal centres, one per row, or ragged with at most one.
    """
    if centers.values.grad is None:
        return None
    gradients = centers.values.grad.abs()
    if centers.offsets is None:
        return gradients
    # One more value, so that an index of trailing rows without values is valid.
    padded = torch.cat([gradients, gradients.new_zeros(1)])
    return torch.where(centers.offsets.diff() > 0, padded[centers.offsets[:-1]], 0.0)
