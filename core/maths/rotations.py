"""Rotations in three dimensions: quaternions (wxyz), matrices, and rotation vectors.

Training differentiates through some of these functions; the order of their operations is part of
its results, to the bit.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Float64, Int16
from torch import Tensor
from torch.nn.functional import normalize

from gsfw.core.numerics import QUATERNION_MIN_NORM

LEVELS = 32767
"""Largest 16-bit integer; the angle error of a stored rotation is 0.006 degrees at most."""

SMALLEST_ANGLE = 1e-4
"""In radians; below it sin(x) / x is 1 in float32, and 1 - 2e-9 in float64."""

UNIT = 1e-6
"""Quaternions as near to unit length as this are left unchanged: rounding to float32 changes them
by less, and another normalisation would change their last bits."""


def rotation_matrices(quats: Float[Tensor, "n 4"]) -> Float[Tensor, "n 3 3"]:
    """Matrices of quaternions of any norm; the identity, with gradient zero, for norms near 0."""
    with torch.no_grad():
        # Division by the largest component first keeps the squares of 1e20 within float32.
        largest = quats.abs().amax(1, keepdim=True)
        safe = torch.where(largest > 0, largest, 1.0)
        none = largest * (quats / safe).norm(dim=1, keepdim=True) < QUATERNION_MIN_NORM
        safe = torch.where(none, 1.0, safe)
    identity = quats.new_tensor([1.0, 0.0, 0.0, 0.0])
    return unit_matrices(normalize(torch.where(none, identity, quats / safe), dim=1))


def unit_matrices(quats: Float[Tensor, "n 4"]) -> Float[Tensor, "n 3 3"]:
    """Matrices of unit quaternions."""
    return torch.stack(_entries(*quats.unbind(1)), dim=1).view(-1, 3, 3)


def matrices_rows_last(quats: Float[Tensor, "n 4"]) -> Float[Tensor, "3 3 n"]:
    """Matrices of quaternions of any norm, rows last: many times faster than rows first."""
    norms = quats.norm(dim=1, keepdim=True).clamp_min(QUATERNION_MIN_NORM)
    return torch.stack(_entries(*(quats / norms).T.contiguous())).view(3, 3, -1)


def _entries(w: Tensor, x: Tensor, y: Tensor, z: Tensor) -> tuple[Tensor, ...]:
    """The nine entries of the matrices of unit quaternions, row by row."""
    return (
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def unit_quaternions(quats: Float64[Tensor, "n 4"]) -> Float64[Tensor, "n 4"]:
    """Quaternions of unit length; those of length 0 become the identity."""
    lengths = quats.norm(dim=1, keepdim=True)
    unit = torch.where((lengths - 1).abs() < UNIT, quats, quats / lengths)
    identity = quats.new_tensor([1.0, 0.0, 0.0, 0.0])
    return torch.where(lengths < QUATERNION_MIN_NORM, identity, unit)


def quaternions_of(rotations: Float[Tensor, "*b 3 3"]) -> Float[Tensor, "*b 4"]:
    """The unit quaternions (w >= 0) of rotation matrices, by their largest components."""
    m = rotations.movedim((-2, -1), (0, 1))
    squares = torch.stack(
        [
            1 + m[0, 0] + m[1, 1] + m[2, 2],
            1 + m[0, 0] - m[1, 1] - m[2, 2],
            1 - m[0, 0] + m[1, 1] - m[2, 2],
            1 - m[0, 0] - m[1, 1] + m[2, 2],
        ]
    )
    products = torch.stack(
        [
            torch.stack([squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]),
            torch.stack([m[2, 1] - m[1, 2], squares[1], m[1, 0] + m[0, 1], m[0, 2] + m[2, 0]]),
            torch.stack([m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], squares[2], m[2, 1] + m[1, 2]]),
            torch.stack([m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[2, 1] + m[1, 2], squares[3]]),
        ]
    )
    largest = squares.argmax(dim=0, keepdim=True)[:, None]
    quat = products.take_along_dim(largest, dim=0)[0].movedim(0, -1)
    quat = quat / quat.norm(dim=-1, keepdim=True)
    return torch.where(quat[..., :1] >= 0, quat, -quat)


def multiply_quaternions(
    first: Float[Tensor, "*b 4"], second: Float[Tensor, "*b 4"]
) -> Float[Tensor, "*b 4"]:
    """Hamilton product: the rotation by ``second``, then by ``first``."""
    a, b, c, d = first.unbind(-1)
    p, q, r, s = second.unbind(-1)
    return torch.stack(
        [
            a * p - b * q - c * r - d * s,
            a * q + b * p + c * s - d * r,
            a * r - b * s + c * p + d * q,
            a * s + b * r - c * q + d * p,
        ],
        dim=-1,
    )


def relative_quaternions(
    quats: Float[Tensor, "n 4"], others: Float[Tensor, "n 4"]
) -> Float[Tensor, "n 4"]:
    """The rotations from ``others`` to ``quats``, unit quaternions: product with the conjugates."""
    w, x, y, z = quats.unbind(1)
    a, b, c, d = others.unbind(1)
    parts = (
        w * a + x * b + y * c + z * d,
        x * a - w * b - y * d + z * c,
        y * a - w * c - z * b + x * d,
        z * a - w * d - x * c + y * b,
    )
    return torch.stack(parts, dim=1)


def same_half(quats: Float[Tensor, "n 4"], others: Float[Tensor, "n 4"]) -> Float[Tensor, "n 4"]:
    """``quats`` with the sign that is nearer to ``others``: q and -q are one rotation."""
    opposite = (quats * others).sum(1, keepdim=True) < 0
    return torch.where(opposite, -quats, quats)


def to_integers(quats: Float[Tensor, "n 4"]) -> Int16[Tensor, "n 4"]:
    """Store quaternions of any norm in 8 bytes each."""
    return (normalize(quats, dim=-1) * LEVELS).round().to(torch.int16)


def from_integers(integers: Int16[Tensor, "n 4"], like: Tensor) -> Float[Tensor, "n 4"]:
    """Unit quaternions of stored ones, in the type of ``like``."""
    return normalize(integers.to(like), dim=-1)


def rotation_vector_matrices(vectors: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3 3"]:
    """Matrices of rotation vectors, in radians (Rodrigues' formula).

    Differentiable at zero, where the matrix is the identity to the bit.
    """
    angles = (vectors * vectors).sum(-1).clamp_min(SMALLEST_ANGLE**2).sqrt()[:, None, None]
    x, y, z = vectors.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).view(-1, 3, 3)
    first = angles.sin() / angles
    second = 0.5 * ((0.5 * angles).sin() / (0.5 * angles)) ** 2
    identity = torch.eye(3, dtype=vectors.dtype, device=vectors.device)
    return identity + first * cross + second * cross @ cross
