"""TwoQuaternions: the left and the right quaternion as trained numbers.

Yang et al. 2024, "Real-time Photorealistic Dynamic Scene Representation and Rendering with 4D
Gaussian Splatting". Our axes are x, y, z, t; those of the released code are z, y, x, t.
"""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from gsfw.methods.rotor4d.rotation import Rotation


class TwoQuaternions(Rotation):
    """Left first, right second."""

    def sides(
        self, first: Float[Tensor, "n 4"], second: Float[Tensor, "n 4"]
    ) -> tuple[Float[Tensor, "n 4"], Float[Tensor, "n 4"]]:
        """Return both unchanged."""
        return first, second

    def numbers(
        self, left: Float[Tensor, "n 4"], right: Float[Tensor, "n 4"]
    ) -> tuple[Float[Tensor, "n 4"], Float[Tensor, "n 4"]]:
        """Return both unchanged."""
        return left, right
