"""How strongly a step pulls at temporal centres, for strategies that grow rows by it."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.column import Column


def center_gradients(centers: Column) -> Float[Tensor, " n"] | None:
    """|dL / d centre| of each row: 0 where it has none; ``None`` before any step.

    Args:
        centers: temporal centres, one for each row, or ragged with at most one.
    """
    if centers.values.grad is None:
        return None
    gradients = centers.values.grad.abs()
    if centers.offsets is None:
        return gradients
    # One more value, so that there is something to read for the last rows when they have none.
    padded = torch.cat([gradients, gradients.new_zeros(1)])
    return torch.where(centers.offsets.diff() > 0, padded[centers.offsets[:-1]], 0.0)
