"""Tangents: forward-mode derivatives, which plain torch alone computes."""

from __future__ import annotations

from collections.abc import Iterable

from torch import Tensor
from torch.autograd import forward_ad


def has_tangents(tensors: Iterable[Tensor | None]) -> bool:
    """True if a tensor carries a forward-mode derivative."""
    given = (tensor for tensor in tensors if tensor is not None)
    return any(forward_ad.unpack_dual(tensor).tangent is not None for tensor in given)
