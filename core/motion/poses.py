"""Poses over time: cubic paths; quaternions and logarithms of scales linear in time; errors."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.motion.least_squares import fit_polynomials

AT_REST = 0.005
"""Part of the bounds below which a motion is none."""
STRAIGHT = 1e-4
"""Change of a unit quaternion below which a row does not turn; a needle of 1 : 100 then moves its
tips by 1 % of its width."""
LOG_RANGE = 80.0
"""Logarithms of scales beyond this leave the range of float32."""
TINY = torch.finfo(torch.float64).tiny


@dataclass(frozen=True)
class Bounds:
    """Largest errors of a piece that fits; all times the opacity relative to the row's largest.

    Measured on 4dgs (built-in scene, 160 x 120, 12 times, 300 steps; PSNR against the model, and
    pieces for each row): 0.1, 0.1, 0.01: 51.8 dB, 5.5; 0.2, 0.2, 0.05: 46.2 dB, 2.3; 0.3, 0.3,
    0.05: 44.2 dB, 2.0; one piece for each row: 34.4 dB.
    """

    length: float
    """Distance that nobody sees, whatever the size of the row; in scene units."""
    position: float = 0.2
    """Distance, relative to the geometric mean of the standard deviations."""
    shape: float = 0.2
    """Difference of covariances (Frobenius norm), relative to them."""
    opacity: float = 0.05
    """Difference; at least that of a row which is left out as nothing of it is seen (1/255)."""


@dataclass(frozen=True)
class Poses:
    """Positions and shapes of p pieces at m samples each."""

    means: Float[Tensor, "p m 3"]
    quats: Float[Tensor, "p m 4"]
    """Quaternions (wxyz) of any norm."""
    scales: Float[Tensor, "p m 3"]

    def covariances(self) -> Float[Tensor, "p m 3 3"]:
        """Shapes."""
        axes = rotation_matrices(self.quats.flatten(0, 1)).view(*self.quats.shape[:2], 3, 3)
        axes = axes * self.scales[:, :, None]
        return axes @ axes.transpose(2, 3)

    def errors(self, fitted: Poses, bounds: Bounds) -> Float[Tensor, "p m"]:
        """The larger of the errors of position and shape of other poses, over their bounds."""
        sizes = self.scales.clamp_min(TINY)
        distance = (fitted.means - self.means).norm(dim=2)
        moved = distance / (bounds.position * sizes.log().mean(2).exp()).clamp_min(bounds.length)
        shapes = self.covariances().flatten(2)
        change = (fitted.covariances().flatten(2) - shapes).norm(dim=2)
        change = change / shapes.norm(dim=2).clamp_min(TINY)
        bent = change / (bounds.length / sizes.amax(2)).clamp_min(bounds.shape)
        return torch.maximum(moved, bent)


@dataclass(frozen=True)
class Moves:
    """Coefficients of the powers of the time since the centre of each piece, from power 0."""

    center: Float[Tensor, " p"]
    path: Float[Tensor, "p 4 3"]
    spin: Float[Tensor, "p 2 4"]
    """Quaternions of any norm."""
    growth: Float[Tensor, "p 2 3"]
    """Logarithms of the scales."""

    def at(self, times: Float[Tensor, "p m"]) -> Poses:
        """The poses at some times of each piece."""
        elapsed = (times - self.center[:, None])[..., None]
        scales = _polynomial(self.growth, elapsed).clamp(-LOG_RANGE, LOG_RANGE).exp()
        return Poses(_polynomial(self.path, elapsed), _polynomial(self.spin, elapsed), scales)

    def unit_quaternions(self) -> tuple[Float[Tensor, "p 4"], Float[Tensor, "p 4"]]:
        """Unit quaternions at the centres, and their changes, of the same rotations."""
        norms = self.spin[:, 0].norm(dim=1, keepdim=True).clamp_min(TINY)
        return self.spin[:, 0] / norms, self.spin[:, 1] / norms


def fit_moves(
    poses: Poses,
    times: Float[Tensor, "p m"],
    weights: Float[Tensor, "p m"],
    center: Float[Tensor, " p"],
    bounds: Bounds,
) -> Moves:
    """The motion of least weighted squares; exactly none where next to nothing moves.

    Args:
        poses: of each piece.
        times: of its samples.
        weights: 0 for samples without a pose.
        center: of the time of each piece.
        bounds: of the errors.
    """
    logarithms = poses.scales.clamp_min(TINY).log().clamp_min(-LOG_RANGE)
    units = poses.quats / poses.quats.norm(dim=2, keepdim=True).clamp_min(TINY)
    sizes = logarithms.mean(2).exp()

    def fit(
        values: Float[Tensor, "p m d"],
        degree: int,
        still: Float[Tensor, "p m d"],
        bound: Float[Tensor, "p m"] | float,
    ) -> Float[Tensor, "p powers d"]:
        found = fit_polynomials(times, weights, values, degree).about(center)
        return _stopped(found, still, weights, bound)

    return Moves(
        center,
        path=fit(poses.means, 3, poses.means, AT_REST * bounds.position * sizes),
        spin=fit(poses.quats, 1, units, STRAIGHT),
        growth=fit(logarithms, 1, logarithms, AT_REST * bounds.shape),
    )


def _stopped(
    coefficients: Float[Tensor, "p powers d"],
    values: Float[Tensor, "p m d"],
    weights: Float[Tensor, "p m"],
    bound: Float[Tensor, "p m"] | float,
) -> Float[Tensor, "p powers d"]:
    """The same polynomials, but the mean of ``values`` where none is farther from it."""
    constant, total = torch.zeros_like(coefficients), weights.sum(1, keepdim=True).clamp_min(TINY)
    constant[:, 0] = (weights[..., None] * values).sum(1) / total
    away = (values - constant[:, :1]).norm(dim=2) * (weights > 0)
    still: Bool[Tensor, " p"] = (away <= bound).all(1)
    return torch.where(still[:, None, None], constant, coefficients)


def _polynomial(
    coefficients: Float[Tensor, "p powers d"], elapsed: Float[Tensor, "p m 1"]
) -> Float[Tensor, "p m d"]:
    total = torch.zeros_like(elapsed)
    for coefficient in reversed(coefficients.unbind(1)):
        total = total * elapsed + coefficient[:, None]
    return total
