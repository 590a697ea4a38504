"""Rotor: r = s + b_xy e_xy + b_xz e_xz + b_yz e_yz + b_xt e_xt + b_yt e_yt + b_zt e_zt + p e_xyzt.

Duan et al. 2024, "4D-Rotor Gaussian Splatting": x is rotated to r x r~ if two constraints hold,
|r| = 1 and eps = p s - b_xy b_zt + b_xz b_yt - b_xt b_yz = 0. The pseudoscalar e_xyzt squares to 1
and commutes with r, so that (1 + e_xyzt) / 2 and (1 - e_xyzt) / 2 split r into two quaternions, the
sum and the difference of (s, -b_yz, b_xz, -b_xy) and (p, b_xt, b_yt, b_zt). Their squared norms are
|r|^2 + 2 eps and |r|^2 - 2 eps: both constraints hold exactly if both norms are 1, and normalising
each is the paper's projection onto the rotors, without its division by eps, which is zero right
after a projection.

The released code never projects: unit norm alone leaves its matrices up to 0.8 from a rotation.
"""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from gsfw.methods.rotor4d.rotation import Rotation


class Rotor(Rotation):
    """A rotor: the quaternion of a rotation of space, then the part that mixes space with time."""

    def sides(
        self, first: Float[Tensor, "n 4"], second: Float[Tensor, "n 4"]
    ) -> tuple[Float[Tensor, "n 4"], Float[Tensor, "n 4"]]:
        """Self-dual and anti-self-dual part."""
        return first + second, first - second

    def numbers(
        self, left: Float[Tensor, "n 4"], right: Float[Tensor, "n 4"]
    ) -> tuple[Float[Tensor, "n 4"], Float[Tensor, "n 4"]]:
        """Half of the sum, and half of the difference, which is zero for rotations of space."""
        return (left + right) / 2, (left - right) / 2
