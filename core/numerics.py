"""Every conventional constant of splatting, under one name, for all backends."""

from __future__ import annotations

from dataclasses import dataclass, replace

NEAR = 0.01
"""Default near plane, in scene units of view depth (gsplat's default)."""

FAR = 1e10
"""Default far plane, in scene units of view depth (gsplat's default)."""

QUATERNION_MIN_NORM = 1e-12
"""Quaternions shorter than this count as the identity rotation, with gradient zero."""

DEPTH_MIN = 1e-12
"""Nearer splats are never drawn, whatever the near plane: 1 / depth squared must fit float32."""

LENGTH_MAX = 1e9
"""Standard deviations are cut off here, in scene units and again in pixels, and splats centred
further off in the image (pixels) are not drawn: fourth powers of this still fit float32."""


@dataclass(frozen=True)
class NumericsProfile:
    """The cut-offs and constants a rasterizer draws with.

    The values are those of Kerbl et al. 2023 as gsplat 1.6 has them; the named profiles differ
    only where another renderer must be matched.
    """

    name: str = "default"
    dilation: float = 0.3
    """Added to the diagonal of every projected covariance, in pixels squared."""
    alpha_max: float = 0.99
    """Alpha is clamped here; its gradient is zero where the clamp is active."""
    alpha_min: float = 1.0 / 255.0
    """A splat whose alpha at a pixel is below this is not drawn there."""
    transmittance_min: float = 1e-4
    """A splat that would bring the transmittance to this or below is not drawn, nor any behind."""
    jacobian_margin: float = 0.3
    """x/z and y/z are clamped this far beyond the image, in fractions of the field of view."""
    compensation_min: float = 0.005
    """Floor of the antialiasing factor sqrt(det before / det after dilation)."""
    depth_epsilon: float = 1e-10
    """Floor of the accumulated alpha that expected depth is divided by."""

    def without_cutoffs(self) -> NumericsProfile:
        """The same with every cut-off disabled, as finite differences need it."""
        return replace(
            self,
            name=f"{self.name}, no cut-offs",
            alpha_max=1.0,
            alpha_min=0.0,
            transmittance_min=0.0,
        )


DEFAULT = NumericsProfile()
GSPLAT_1_5 = NumericsProfile(name="gsplat-1.5", alpha_max=0.999, compensation_min=1e-6)
"""gsplat 1.5 has no floor of the compensation: 1e-6 keeps its derivative finite, and whatever is
compensated by less than 1 / 255 is not drawn."""

PROFILES = {profile.name: profile for profile in (DEFAULT, GSPLAT_1_5)}
