"""The projection of diff-gaussian-rasterization (Kerbl et al. 2023), with its conventions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.api import NumericsProfile, unit_matrices
from gsfw.compat.screen import (
    Covariances,
    ScreenSplats,
    determinant,
    project_axes,
    project_covariances,
    view_colors,
)

NEAR = 0.2
"""Splats of this view depth or less are not rendered. As the other constants here, a convention
of diff-gaussian-rasterization that the paper does not state."""
CLIP_EPSILON = 1e-7
"""Added to the divisor of the perspective projection."""
SLOPE_LIMIT = 1.3
"""x / z and y / z are clamped here for the covariance, in tangents of half the field of view."""
SIGMAS = 3.0
"""A radius, in standard deviations of the longer axis; rounded up."""
SPREAD_MIN = 0.1
"""Floor under the root in the eigenvalues of a covariance."""
TILE = 16
"""Side of a tile in pixels; a splat without a tile has radius 0."""
AREA_EPSILON = 1e-6
"""In the compensation of Mip-Splatting: added to the divisor and below the root, and the least
determinant before dilation of a splat that is rendered; in pixels to the fourth."""


@dataclass(frozen=True)
class InriaView:
    """A view."""

    width: int
    height: int
    tangents: tuple[float, float]
    """Tangents of half the fields of view, x and y."""
    view: Float[Tensor, "4 4"]
    """World to camera, transposed."""
    projection: Float[Tensor, "4 4"]
    """World to clip space, transposed."""
    center: Float[Tensor, " 3"]
    """The camera's place in the world."""
    degree: int
    """Degree of spherical harmonics."""
    scale: float
    """Factor of standard deviations; covariances that are given are not scaled."""
    compensation: Callable[[Covariances, NumericsProfile], Float[Tensor, " m"]] | None
    """Factor of opacities for the area that dilation adds, if there is one."""
    profile: NumericsProfile
    """Dilation 0.3 unless the fork has another, alpha at most 0.99 and at least 1 / 255, stop below
    transmittance 1e-4, floor of the compensation sqrt(0.000025): all are gsfw's own defaults."""

    def in_front(self, means: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        """True for the points beyond the near plane."""
        return means @ self.view[:3, 2] + self.view[3, 2] > NEAR

    def in_camera(self, means: Float[Tensor, "m 3"]) -> Float[Tensor, "m 3"]:
        """Points in the camera's axes."""
        return means @ self.view[:3, :3] + self.view[3, :3]

    def pixels(self, means: Float[Tensor, "m 3"]) -> Float[Tensor, "m 2"]:
        """Points in the image; the first pixel's centre is at (0.5, 0.5)."""
        clip = means @ self.projection[:3] + self.projection[3]
        device = clip[:, :2] / (clip[:, 3:] + CLIP_EPSILON)
        return (device + 1) * self.half_size(means)

    def half_size(self, like: Tensor) -> Float[Tensor, " 2"]:
        """Pixels per unit of normalized device coordinates."""
        return like.new_tensor([0.5 * self.width, 0.5 * self.height])

    def jacobian(self, points: Float[Tensor, "m 3"]) -> Float[Tensor, "2 3 m"]:
        """The derivative of pixels by points in the camera."""
        x, y, z = points.unbind(1)
        limits = [SLOPE_LIMIT * tangent for tangent in self.tangents]
        x, y = (x / z).clamp(-limits[0], limits[0]), (y / z).clamp(-limits[1], limits[1])
        focal = [0.5 * self.width / self.tangents[0], 0.5 * self.height / self.tangents[1]]
        across, down, none = focal[0] / z, focal[1] / z, torch.zeros_like(z)
        rows = [across, none, -x * across, none, down, -y * down]
        return torch.stack(rows).view(2, 3, -1)


@dataclass(frozen=True)
class InriaGaussians:
    """Gaussians as the original takes them."""

    means: Float[Tensor, "m 3"]
    opacities: Float[Tensor, "m 1"]
    shs: Float[Tensor, "m k 3"] | None
    colors: Float[Tensor, "m d"] | None
    """Instead of ``shs``."""
    scales: Float[Tensor, "m 3"] | None
    rotations: Float[Tensor, "m 4"] | None
    covariances: Float[Tensor, "m 6"] | None
    """Instead of scales and rotations: upper halves, row by row."""

    def in_image(self, view: InriaView) -> Covariances:
        """Covariances in the image."""
        rotation, jacobian = view.view[:3, :3].T, view.jacobian(view.in_camera(self.means))
        if self.covariances is not None:
            whole = self.covariances[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].view(-1, 3, 3)
            return project_covariances(whole, rotation, jacobian)
        assert self.scales is not None
        assert self.rotations is not None
        # The original takes quaternions for unit ones, and so deforms splats where they are not.
        axes = unit_matrices(self.rotations) * (view.scale * self.scales)[:, None]
        return project_axes(axes, rotation, jacobian)

    def seen(self, view: InriaView) -> Float[Tensor, "m d"]:
        """Colours from the camera."""
        if self.colors is not None:
            return self.colors
        assert self.shs is not None
        return view_colors(self.shs, view.degree, self.means - view.center)


def project(gaussians: InriaGaussians, view: InriaView) -> tuple[ScreenSplats, Int[Tensor, " m"]]:
    """Project splats that are all in front of the camera, differentiably.

    Returns:
        The splats, and their radii in pixels as the original defines them.
    """
    means, covariances = view.pixels(gaussians.means), gaussians.in_image(view)
    opacities = gaussians.opacities.flatten()
    if view.compensation is not None:
        opacities = opacities * view.compensation(covariances, view.profile)
    radii = _radii(means.detach(), covariances.detach(), view)
    depths = view.in_camera(gaussians.means)[:, 2]
    colors = gaussians.seen(view)
    return ScreenSplats(means, depths, covariances, opacities, colors, radii > 0), radii


def mip_compensation(covariances: Covariances, profile: NumericsProfile) -> Float[Tensor, " m"]:
    """The factor of Mip-Splatting's own kernels (Yu et al. 2024, equation 9), with their epsilons.

    It is 0 for splats without area in the image.
    """
    before, after = determinant(covariances, 0.0), determinant(covariances, profile.dilation)
    seen = (before > AREA_EPSILON) & (after > AREA_EPSILON)
    ratio = torch.where(seen, before / (after + AREA_EPSILON), 0.0)
    return torch.where(seen, (ratio + AREA_EPSILON).sqrt(), 0.0)


def _radii(
    means: Float[Tensor, "m 2"], covariances: Covariances, view: InriaView
) -> Int[Tensor, " m"]:
    """Radii of three standard deviations, rounded up; 0 where the square meets no tile."""
    middle = 0.5 * (covariances[0] + covariances[2]) + view.profile.dilation
    spread = middle * middle - determinant(covariances, view.profile.dilation)
    radii = (SIGMAS * (middle + spread.clamp_min(SPREAD_MIN).sqrt()).sqrt()).ceil()
    corners, reach = means - 0.5, radii[:, None]
    tiles = means.new_tensor([-(-view.width // TILE), -(-view.height // TILE)])
    first = ((corners - reach) / TILE).trunc().clamp(min=torch.zeros_like(tiles), max=tiles)
    last = ((corners + reach + TILE - 1) / TILE).trunc()
    last = last.clamp(min=torch.zeros_like(tiles), max=tiles)
    # Comparisons with NaN are false.
    return torch.where((last > first).all(1), radii, 0.0).int()
