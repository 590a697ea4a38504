"""The projection of gsplat 1.5, with its conventions: three camera models, radii per axis."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.api import NumericsProfile, rotation_matrices
from gsfw.compat.screen import Covariances, project_axes, project_covariances

MODELS = ("pinhole", "ortho", "fisheye")

SIGMAS = 3.33
"""A radius, in standard deviations along an axis, unless opacity ends the splat earlier."""
SERIES_BELOW = 1e-4
"""Squared slope below which the fisheye's ratios are series, to the second power of it."""


@dataclass(frozen=True)
class GsplatCamera:
    """One camera."""

    world_to_camera: Float[Tensor, "4 4"]
    intrinsics: Float[Tensor, "3 3"]
    """In pixels; in pixels per scene unit for "ortho"."""
    width: int
    height: int
    model: str
    """One of ``MODELS``."""

    @property
    def rotation(self) -> Float[Tensor, "3 3"]:
        """From the scene to the camera."""
        return self.world_to_camera[:3, :3]

    @property
    def center(self) -> Float[Tensor, " 3"]:
        """The camera's place in the scene."""
        return -(self.rotation.T @ self.world_to_camera[:3, 3])

    def in_camera(self, means: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Points in the camera's axes."""
        return means @ self.rotation.T + self.world_to_camera[:3, 3]

    def project(
        self, points: Float[Tensor, "n 3"]
    ) -> tuple[Float[Tensor, "n 2"], Float[Tensor, "2 3 n"]]:
        """Points in pixels, and the derivative by points in the camera; depths are positive."""
        focal, principal = self.intrinsics.diagonal()[:2], self.intrinsics[:2, 2]
        x, y, z = points.unbind(1)
        one, none = torch.ones_like(z), torch.zeros_like(z)
        if self.model == "ortho":
            pixels = points[:, :2] * focal + principal
            jacobian = torch.stack([one, none, none, none, one, none])
            return pixels, jacobian.view(2, 3, -1) * focal[:, None, None]
        slopes = torch.stack([x / z, y / z])
        if self.model == "fisheye":
            slopes, jacobian = _equidistant(slopes)
        else:
            low, high = self._slope_limits(focal, principal)
            across, down = slopes.clamp(low[:, None], high[:, None])
            jacobian = torch.stack([one, none, -across, none, one, -down]).view(2, 3, -1)
        pixels = (slopes * focal[:, None] + principal[:, None]).T
        return pixels, jacobian * focal[:, None, None] / z

    def _slope_limits(
        self, focal: Float[Tensor, " 2"], principal: Float[Tensor, " 2"]
    ) -> tuple[Float[Tensor, " 2"], Float[Tensor, " 2"]]:
        """Bounds of x / z and y / z in the covariance: 0.15 of the image beyond its edges."""
        size = focal.new_tensor([self.width, self.height])
        beyond = NumericsProfile().jacobian_margin * 0.5 * size / focal
        return -principal / focal - beyond, (size - principal) / focal + beyond


def _equidistant(slopes: Float[Tensor, "2 n"]) -> tuple[Float[Tensor, "2 n"], Tensor]:
    """The fisheye r = theta at unit focal length, and its derivative by points, times depth.

    With s the squared slope, atan(sqrt(s)) / sqrt(s) scales the slopes; ``bend`` is twice its
    derivative by s.
    """
    squared = slopes.square().sum(0)
    near_axis = squared < SERIES_BELOW
    large, small = torch.where(near_axis, 1.0, squared), torch.where(near_axis, squared, 0.0)
    root = large.sqrt()
    ratio = torch.where(near_axis, 1 - small / 3 + small.square() / 5, root.atan() / root)
    bend = torch.where(
        near_axis,
        -2 / 3 + 4 * small / 5 - 6 * small.square() / 7,
        (1 / (1 + large) - root.atan() / root) / large,
    )
    x, y = slopes
    along = -slopes / (1 + squared)
    rows = [ratio + bend * x * x, bend * x * y, along[0], bend * x * y, ratio + bend * y * y]
    return slopes * ratio, torch.stack([*rows, along[1]]).view(2, 3, -1)


def covariances_in_image(
    camera: GsplatCamera,
    quats: Float[Tensor, "n 4"] | None,
    scales: Float[Tensor, "n 3"] | None,
    covars: Float[Tensor, "n 3 3"] | None,
    jacobian: Float[Tensor, "2 3 n"],
) -> Covariances:
    """Covariances in the image: of ``covars`` if given, else of axes; before dilation."""
    if covars is not None:
        return project_covariances(covars, camera.rotation, jacobian)
    assert quats is not None
    assert scales is not None
    return project_axes(rotation_matrices(quats) * scales[:, None], camera.rotation, jacobian)


def axis_radii(
    means: Float[Tensor, "n 2"],
    covariances: Covariances,
    opacities: Float[Tensor, " n"],
    in_range: Bool[Tensor, " n"],
    camera: GsplatCamera,
    profile: NumericsProfile,
) -> Int[Tensor, "n 2"]:
    """Half the sides of bounding boxes, in whole pixels; 0 where a splat is not in the image."""
    ends = 2 * (opacities / profile.alpha_min).clamp_min(1.0).log()
    reach = ends.sqrt().clamp_max(SIGMAS)[:, None]
    radii = (reach * (covariances[::2].T + profile.dilation).sqrt()).ceil()
    size = means.new_tensor([camera.width, camera.height])
    inside = ((means + radii > 0) & (means - radii < size)).all(1)
    seen = inside & in_range & (opacities >= profile.alpha_min)
    return torch.where(seen[:, None], radii, 0.0).int()
