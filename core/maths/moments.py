"""Moments: mass, mean and covariance of splats, and those of two splats together.

The mass of a splat is its opacity times its area. Two of them together have the mean and covariance
of the mixture (law of total covariance), as in hierarchies of Gaussian mixtures (Goldberger and
Roweis 2004; Kerbl et al. 2024, A Hierarchical 3D Gaussian Representation, equations 4 and 5). Here
the area is the product of the two longest axes; Kerbl et al. take the surface of the ellipsoid.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.maths.frame import with_axes
from gsfw.core.maths.rotations import unit_matrices
from gsfw.core.maths.spherical_harmonics import degree_of
from gsfw.core.splats import Sh, Splats


@dataclass(frozen=True)
class Moments:
    """Moments of ``n`` splats, or of ``n`` sets of them."""

    masses: Float[Tensor, " n"]
    """Opacity times area, summed."""
    means: Float[Tensor, "n 3"]
    covariances: Float[Tensor, "n 3 3"]
    colors: Float[Tensor, "n k 3"]
    """SH coefficients, the means by mass."""
    highest: Float[Tensor, " n"]
    """Largest opacity of a member."""

    def __len__(self) -> int:
        return len(self.masses)

    @staticmethod
    def of(splats: Splats) -> Moments:
        """The moments of each splat.

        Args:
            splats: with quaternions, scales and SH colours, in float64.
        """
        assert splats.quats is not None
        assert splats.scales is not None
        assert isinstance(splats.colors, Sh)
        quats = splats.quats / splats.quats.norm(dim=1, keepdim=True).clamp_min(1e-12)
        sides = unit_matrices(quats) * splats.scales[:, None, :]
        return Moments(
            splats.opacities * areas(splats),
            splats.means,
            sides @ sides.transpose(1, 2),
            splats.colors.dense(),
            splats.opacities,
        )

    def take(self, rows: slice | Int[Tensor, " r"]) -> Moments:
        """The moments of some rows."""
        return Moments(*(getattr(self, field.name)[rows] for field in fields(self)))

    @staticmethod
    def cat(parts: list[Moments]) -> Moments:
        """The rows of several, one after the other."""
        names = [field.name for field in fields(Moments)]
        return Moments(*(torch.cat([getattr(part, name) for part in parts]) for name in names))

    @staticmethod
    def joined(one: Moments, other: Moments) -> Moments:
        """The moments of each row of ``one`` together with the same row of ``other``."""
        masses = one.masses + other.masses
        shares = (one.masses / masses.clamp_min(1e-300)).where(masses > 0, 0.5)
        # By the difference of the means: no cancellation far from the origin.
        apart = other.means - one.means
        between = (shares * (1 - shares))[:, None, None] * apart[:, :, None] * apart[:, None, :]
        share = shares[:, None, None]
        of_color = share.to(one.colors)
        return Moments(
            masses,
            one.means + (1 - shares)[:, None] * apart,
            share * one.covariances + (1 - share) * other.covariances + between,
            of_color * one.colors + (1 - of_color) * other.colors,
            torch.maximum(one.highest, other.highest),
        )

    def splats(self, most_opaque: float) -> Splats:
        """A splat with the moments of each row.

        Its opacity keeps the mass, as far as it is below ``most_opaque`` or that of a member.
        """
        degree = degree_of(self.colors.shape[1])
        placed = with_axes(
            Splats(
                means=self.means,
                opacities=self.highest,
                colors=Sh(self.colors, degree),
                covariances=self.covariances,
            )
        )
        opacities = self.masses / areas(placed).clamp_min(1e-300)
        return Splats(
            means=placed.means,
            opacities=torch.minimum(opacities, self.highest.clamp_min(most_opaque)),
            colors=placed.colors,
            quats=placed.quats,
            scales=placed.scales,
        )


def areas(splats: Splats) -> Float[Tensor, " n"]:
    """Product of the two longest axes of each splat."""
    assert splats.scales is not None
    return splats.scales.sort(dim=1).values[:, 1:].prod(1)
