"""Dot products of vectors whose members are tensors: entry by entry, for all rows."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor


def dot(first: Sequence[Tensor], second: Sequence[Tensor]) -> Tensor:
    """Sum of the products of their members."""
    total = first[0] * second[0]
    for one, other in zip(first[1:], second[1:], strict=True):
        total = torch.addcmul(total, one, other)
    return total
