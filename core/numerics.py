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
"""Splats nearer than this are never rendered, whatever the near plane: 1 / depth squared must
fit float32."""

MAX_LOG_SCALE = 88.0
"""Largest logarithm of a scale, as files hold it, whose exp is finite in float32."""

LENGTH_MAX = 1e9
"""Upper bound of standard deviations, in scene units and again in pixels. Splats with a centre
further outside the image (pixels) are not rendered: fourth powers of this still fit float32."""


@dataclass(frozen=True)
class NumericsProfile:
    """Cut-offs and constants of a rasterizer.

    The values are those of Kerbl et al. 2023 as in gsplat 1.6; the named profiles differ only to
    match another renderer.
    """

    name: str = "default"
    dilation: float = 0.3
    """Variance added to the diagonal of every projected covariance, in pixels squared."""
    alpha_max: float = 0.99
    """Upper bound of alpha; its gradient is zero where the clamp is active."""
    alpha_min: float = 1.0 / 255.0
    """A splat whose alpha at a pixel is below this is not blended there."""
    transmittance_min: float = 1e-4
    """A splat that would lower the transmittance to this or below ends the pixel, unblended."""
    jacobian_margin: float = 0.3
    """x/z and y/z are clamped this far beyond the image, in tangents of half the field of view."""
    compensation_min: float = 0.005
    """Floor of the antialiasing factor sqrt(det before / det after dilation)."""
    depth_epsilon: float = 1e-10
    """Floor of the accumulated alpha, the divisor of expected depth."""

    def without_cutoffs(self) -> NumericsProfile:
        """The same profile with every cut-off disabled, for finite differences."""
        return replace(
            self,
            name=f"{self.name}, no cut-offs",
            alpha_max=1.0,
            alpha_min=0.0,
            transmittance_min=0.0,
        )


DEFAULT = NumericsProfile()
FAINTEST = DEFAULT.alpha_min * (1 - 1e-6)
"""Least opacity of a splat that counts as visible: 1/255, less the rounding of a float32 logit.
Formats with opacities of 8 bits have many splats of exactly 1/255."""
GSPLAT_1_5 = NumericsProfile(name="gsplat-1.5", alpha_max=0.999, compensation_min=1e-6)
"""gsplat 1.5 has no floor of the compensation: 1e-6 keeps its derivative finite, and a splat with
a compensation below 1 / 255 is not rendered."""

PROFILES = {profile.name: profile for profile in (DEFAULT, GSPLAT_1_5)}
