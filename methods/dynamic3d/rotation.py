"""Rotation: quaternions (wxyz) as matrices, relative to one another, and in few bits."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int16
from torch import Tensor
from torch.nn.functional import normalize

LEVELS = 32767
"""Largest 16-bit integer; the angle of a stored rotation is off by 0.006 degrees at most."""


def to_integers(quats: Float[Tensor, "n 4"]) -> Int16[Tensor, "n 4"]:
    """Quaternions of any norm in 8 bytes each."""
    return (normalize(quats, dim=-1) * LEVELS).round().to(torch.int16)


def from_integers(integers: Int16[Tensor, "n 4"], like: Tensor) -> Float[Tensor, "n 4"]:
    """Unit quaternions again, in the type of ``like``."""
    return normalize(integers.to(like), dim=-1)


def relative(quats: Float[Tensor, "n 4"], others: Float[Tensor, "n 4"]) -> Float[Tensor, "n 4"]:
    """What turns ``others`` into ``quats``: the product with their conjugates, of unit norm."""
    w, x, y, z = quats.unbind(1)
    a, b, c, d = others.unbind(1)
    parts = (
        w * a + x * b + y * c + z * d,
        x * a - w * b - y * d + z * c,
        y * a - w * c - z * b + x * d,
        z * a - w * d - x * c + y * b,
    )
    return torch.stack(parts, dim=1)


def matrices(quats: Float[Tensor, "n 4"]) -> Float[Tensor, "n 3 3"]:
    """Rotation matrices of unit quaternions."""
    w, x, y, z = quats.unbind(1)
    entries = (
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack(entries, dim=1).view(-1, 3, 3)


def same_half(quats: Float[Tensor, "n 4"], others: Float[Tensor, "n 4"]) -> Float[Tensor, "n 4"]:
    """``quats`` with the sign that is nearer to ``others``: q and -q are one rotation."""
    opposite = (quats * others).sum(1, keepdim=True) < 0
    return torch.where(opposite, -quats, quats)
