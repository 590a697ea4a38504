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

from gsfw.core.maths.slices import normalised, rotation_matrices, time_rows


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
        return rotation_matrices(*self.sides(first, second))

    def time_rows(
        self, first: Float[Tensor, "n 4"], second: Float[Tensor, "n 4"]
    ) -> Float[Tensor, "4 n"]:
        """The last rows of ``matrices``: the components of each axis along time."""
        return time_rows(*self.sides(first, second))

    @torch.no_grad()
    def project_(self, first: Float[Tensor, "n 4"], second: Float[Tensor, "n 4"]) -> None:
        """Move both, in place, to the numbers of a rotation: left and right of norm 1."""
        left, right = map(normalised, self.sides(first, second))
        for values, projected in zip((first, second), self.numbers(left, right), strict=True):
            values.copy_(projected)
