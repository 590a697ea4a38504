"""Rotation: maps eight trained numbers to a rotation of space and time.

Every rotation of four dimensions is x -> l x conj(r), with points as quaternions x (time is their
real part) and two unit quaternions, l and r: left and right. Forms differ in the map from the
numbers to these two. All forms keep the matrix a rotation in the same way: left and right are
normalised, with gradient, at every use, and permanently after every optimizer step.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.numerics import QUATERNION_MIN_NORM
from gsfw.methods.rotor4d.dot import dot


class Rotation(ABC):
    """A form of the eight numbers, which are stored as two quaternions (wxyz): first and second."""

    @abstractmethod
    def sides(
        self, first: Float[Tensor, "n 4"], second: Float[Tensor, "n 4"]
    ) -> tuple[Float[Tensor, "n 4"], Float[Tensor, "n 4"]]:
        """Left and right quaternion, of any norm; linear."""

    @abstractmethod
    def numbers(
        self, left: Float[Tensor, "n 4"], right: Float[Tensor, "n 4"]
    ) -> tuple[Float[Tensor, "n 4"], Float[Tensor, "n 4"]]:
        """First and second quaternion: the inverse of ``sides``."""

    def of_space(
        self, quats: Float[Tensor, "n 4"]
    ) -> tuple[Float[Tensor, "n 4"], Float[Tensor, "n 4"]]:
        """The numbers of rotations, by quaternions of any norm, that keep time unchanged."""
        unit = normalised(quats)
        return self.numbers(unit, unit)

    def matrices(
        self, first: Float[Tensor, "n 4"], second: Float[Tensor, "n 4"]
    ) -> Float[Tensor, "4 4 n"]:
        """Rotation matrices of x, y, z, t; rows last, which is many times faster than first."""
        left, right = map(normalised, self.sides(first, second))
        rows, columns = _left_rows(left), _right_columns(right)
        return torch.stack([dot(row, column) for row in rows for column in columns]).view(4, 4, -1)

    def time_rows(
        self, first: Float[Tensor, "n 4"], second: Float[Tensor, "n 4"]
    ) -> Float[Tensor, "4 n"]:
        """The last rows of ``matrices``: the components of each axis along time."""
        left, right = map(normalised, self.sides(first, second))
        return torch.stack([dot(_left_rows(left)[3], column) for column in _right_columns(right)])

    @torch.no_grad()
    def project_(self, first: Float[Tensor, "n 4"], second: Float[Tensor, "n 4"]) -> None:
        """Move both, in place, to the numbers of a rotation: left and right of norm 1."""
        left, right = map(normalised, self.sides(first, second))
        for values, projected in zip((first, second), self.numbers(left, right), strict=True):
            values.copy_(projected)


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
