"""Slices of Gaussians of space and time at one instant: conditional Gaussians.

Duan et al. 2024 and Yang et al. 2024: with M = R S, whose last row is m and whose others are M3,
the covariance of space and time is M M^T, and given the time t

    variance = |m|^2,  velocity = M3 m / |m|^2,  mean(t) = x + velocity (t - center),
    covariance = P P^T  with  P = M3 - (M3 m) m^T / |m|^2,

which is positive semi-definite by construction; the difference of two large matrices, as in
released codes, is not (in float32, with scales of 1e-4 in space and 10 in time, in 98% of samples).
We expand P further, with r for the last row of R and s for the scales:

    P_ij = s_j / |m|^2 * sum over k of (R_ij r_k - R_ik r_j) s_k^2 r_k.

This subtracts no numbers of different size: in float32 the relative error stays below 1e-6, while
that of the first form of P is 0.02 (scales of 1e-4 and 100) or above 1 (1e-4 and 1e4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.numerics import QUATERNION_MIN_NORM

MIN_VARIANCE = 1e-30
"""Least variance, whose inverse float32 can hold; models keep far above it."""

AXES = range(4)
"""Axes before the rotation: x, y, z and t."""


class Slices(NamedTuple):
    """Slices of ``n`` Gaussians; only their means and weights depend on the time."""

    covariances: Float[Tensor, "n 3 3"]
    """Covariances, symmetric to the bit, in scene units squared."""
    velocities: Float[Tensor, "n 3"]
    """Velocity in scene units per sequence."""
    variances: Float[Tensor, " n"]
    """Variance of the time, in sequences squared."""


def slices(
    left: Float[Tensor, "n 4"], right: Float[Tensor, "n 4"], scales: Float[Tensor, "n 4"]
) -> Slices:
    """Slices of Gaussians with rotations x -> l x conj(r) and scales along their axes.

    Args:
        left: left quaternions of any norm.
        right: right quaternions of any norm.
        scales: standard deviations, the last one in sequences; positive.
    """
    found = conditional(rotation_matrices(left, right), scales)
    return Slices(found.covariances, found.velocities, found.variances)


@dataclass(frozen=True)
class Conditional:
    """Slices of ``n`` Gaussians, with the factors of their covariances, to sample from them."""

    factors: Float[Tensor, "3 4 n"]
    """Factor P of the covariance P P^T; times a unit normal, it samples from the Gaussian."""
    velocities: Float[Tensor, "n 3"]
    """Velocity in scene units per sequence."""
    variances: Float[Tensor, " n"]
    """Variance of the time, in sequences squared."""

    @property
    def covariances(self) -> Float[Tensor, "n 3 3"]:
        """Covariances, symmetric to the bit, in scene units squared."""
        x, y, z = (row.unbind(0) for row in self.factors.unbind(0))
        xy, xz, yz = dot(x, y), dot(x, z), dot(y, z)
        entries = [dot(x, x), xy, xz, xy, dot(y, y), yz, xz, yz, dot(z, z)]
        return torch.stack(entries, dim=1).view(-1, 3, 3)


def conditional(rotations: Float[Tensor, "4 4 n"], scales: Float[Tensor, "n 4"]) -> Conditional:
    """The conditional Gaussians of rotation matrices (of x, y, z, t) and scales along their axes.

    Entry by entry for all rows: several times faster than products of small matrices.

    Args:
        rotations: rows last.
        scales: standard deviations, the last one in sequences; positive.
    """
    *space, time = (row.unbind(0) for row in rotations.unbind(0))
    along = scales.T.contiguous().unbind(0)
    pulls = [scale * scale * share for scale, share in zip(along, time, strict=True)]
    variances = time_variances(rotations[3], scales)
    relative = torch.stack(along) / variances
    return Conditional(
        factors=torch.stack([torch.stack(_pulled(row, time, pulls)) * relative for row in space]),
        velocities=torch.stack([dot(row, pulls) / variances for row in space], dim=1),
        variances=variances,
    )


def _pulled(
    row: Sequence[Tensor], time: Sequence[Tensor], pulls: Sequence[Tensor]
) -> list[Float[Tensor, " n"]]:
    """Sum over k of (row_j time_k - row_k time_j) pull_k, for each j."""
    minors = {(j, k): row[j] * time[k] - row[k] * time[j] for j, k in combinations(AXES, 2)}
    minors |= {(k, j): -minor for (j, k), minor in minors.items()}
    others = [[k for k in AXES if k != j] for j in AXES]
    return [dot([minors[j, k] for k in others[j]], [pulls[k] for k in others[j]]) for j in AXES]


def time_variances(time: Float[Tensor, "4 n"], scales: Float[Tensor, "n 4"]) -> Float[Tensor, " n"]:
    """|m|^2, from the last rows of the rotation matrices."""
    return (time * scales.T).square().sum(0).clamp_min(MIN_VARIANCE)


def rotation_matrices(
    left: Float[Tensor, "n 4"], right: Float[Tensor, "n 4"]
) -> Float[Tensor, "4 4 n"]:
    """Matrices of x -> l x conj(r), for x, y, z, t; rows last, which is many times faster.

    Every rotation of four dimensions has this form, with points as quaternions (time is their real
    part) and two quaternions, which are normalised here, with gradient.
    """
    rows, columns = _left_rows(normalised(left)), _right_columns(normalised(right))
    return torch.stack([dot(row, column) for row in rows for column in columns]).view(4, 4, -1)


def time_rows(left: Float[Tensor, "n 4"], right: Float[Tensor, "n 4"]) -> Float[Tensor, "4 n"]:
    """The last rows of ``rotation_matrices``: the components of each axis along time."""
    columns = _right_columns(normalised(right))
    return torch.stack([dot(_left_rows(normalised(left))[3], column) for column in columns])


def normalised(quats: Float[Tensor, "n 4"]) -> Float[Tensor, "n 4"]:
    """Quaternions of norm 1; those of norm near 0 become the identity, with gradient zero."""
    size = quats.detach().abs().amax(dim=1, keepdim=True)
    identity = torch.eye(1, 4, dtype=quats.dtype, device=quats.device)
    # Division by the largest component first keeps squares within float32.
    scaled = quats / size.clamp_min(QUATERNION_MIN_NORM)
    scaled = torch.where(size > QUATERNION_MIN_NORM, scaled, identity)
    return scaled / scaled.norm(dim=1, keepdim=True)


def _left_rows(quats: Float[Tensor, "n 4"]) -> list[list[Tensor]]:
    """Rows of the matrices of x -> q x, for points x, y, z, t."""
    w, x, y, z = quats.T.contiguous().unbind(0)
    return [[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]]


def _right_columns(quats: Float[Tensor, "n 4"]) -> list[list[Tensor]]:
    """Columns of the matrices of x -> x conj(q), for points x, y, z, t."""
    w, x, y, z = quats.T.contiguous().unbind(0)
    return [[w, z, -y, x], [-z, w, x, y], [y, -x, w, z], [-x, -y, -z, w]]


def dot(first: Sequence[Tensor], second: Sequence[Tensor]) -> Tensor:
    """Sum of the products of their members: entry by entry, for all rows."""
    total = first[0] * second[0]
    for one, other in zip(first[1:], second[1:], strict=True):
        total = torch.addcmul(total, one, other)
    return total


def weights(elapsed: Float[Tensor, " n"], variances: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Opacity factor exp(-elapsed^2 / (2 variance)) at some time from the centre."""
    return torch.exp(-0.5 * elapsed.square() / variances)
