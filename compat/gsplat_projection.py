"""The projection of gsplat 1.5, with its conventions: three camera models, radii per axis."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.api import (
    CameraModel,
    Cameras,
    NumericsProfile,
    project_points,
    rotation_matrices,
)
from gsfw.compat.screen import Covariances, project_axes, project_covariances

MODELS = {
    "pinhole": CameraModel.PINHOLE,
    "ortho": CameraModel.ORTHOGRAPHIC,
    "fisheye": CameraModel.FISHEYE,
}
"""Camera models by the names of gsplat."""

SIGMAS = 3.33
"""A radius, in standard deviations along an axis, unless opacity ends the splat earlier."""


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
        pose, intrinsics = self.world_to_camera[None], self.intrinsics[None]
        camera = Cameras(pose, intrinsics, self.width, self.height, MODELS[self.model])
        pixels, jacobian = project_points(points, camera, NumericsProfile().jacobian_margin)
        return pixels, jacobian.permute(1, 2, 0)


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
