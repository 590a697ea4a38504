"""Method 2dgs: surfels with the losses of Huang et al. 2024, "2D Gaussian Splatting".

Depths are those of the ray-splat intersection (``planes``). The footprint of a surfel in the image
is the affine approximation of the rasterizer, as of any Gaussian of gsfw, not the paper's exact
one: they differ for surfels that are large in the image and seen at a slant.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch.nn.functional import cosine_similarity

from gsfw.api import (
    CameraModel,
    ConfigError,
    Feature,
    Needs,
    StaticGaussians,
    StaticGaussiansConfig,
    StaticGaussiansMethod,
    number,
    steps_field,
)
from gsfw_2dgs.planes import CHANNELS, Surface, normals_of, plane_channels

THICKNESS = 1e-3
"""Standard deviation along the normal, relative to the larger one across it."""
NEAR = 0.2
"""Distortion is measured in NDC depth m = 1 - NEAR extents times inverse depth, as in the released
code, where the near plane is 0.2."""
SOLID = 0.5
"""Pixels that surfels cover less have no depth and no normal to compare."""


@dataclass
class SurfelsConfig(StaticGaussiansConfig):
    """2D Gaussian Splatting (after Huang et al. 2024)."""

    distortion_weight: float = number(100.0, at_least=0)
    """Weight of the depth distortion (the paper: 100 for unbounded scenes)."""
    distortion_start: int = steps_field(3000)
    """Steps before depth distortion is in the loss."""
    normal_weight: float = number(0.05, at_least=0)
    """Weight of the consistency of normals and depth."""
    normal_start: int = steps_field(7000)
    """Steps before the consistency is in the loss."""

    def needs(self) -> Needs:
        extra = Needs(features=frozenset({Feature.EXTRA}), extra_channels=CHANNELS)
        return super().needs() | extra

    def build(self):
        return SurfelsMethod(self)


class Surfels(StaticGaussians):
    """Flat Gaussians: the third axis is the normal."""

    depends_on_view = True  # The channels are in the axes of the camera.

    def splats(self, time=None, cameras=None):
        plain = super().splats(time, cameras)
        if cameras is None:
            return plain
        return replace(plain, extra=plane_channels(plain.means, plain.quats, cameras))

    @torch.no_grad()
    def project_(self):
        scales = self.log_scales.values
        scales[:, 2] = scales[:, :2].amax(dim=1) + math.log(THICKNESS)
        super().project_()


class SurfelsMethod(StaticGaussiansMethod):
    model_class = Surfels

    def begin(self, scene, views, model):
        if any(camera.model is not CameraModel.PINHOLE for camera in views.cameras):
            raise ConfigError(
                "method 2dgs: planes are straight lines of inverse depth in pinhole images only.",
                "Leave out datamanager.fisheye=keep, so that images are undistorted.",
            )
        model.project_()
        self.unit = scene.world_from_scene.scale

    def losses(self, context):
        losses, config = dict(super().losses(context)), self.config
        surface = Surface(context.rendered, context.batch.cameras)
        if config.distortion_weight > 0 and context.step >= config.distortion_start:
            in_ndc = (NEAR * context.extent) ** 2 * surface.distortion()
            losses["distortion"] = config.distortion_weight * in_ndc.mean()
        if config.normal_weight > 0 and context.step >= config.normal_start:
            inner = (slice(1, -1), slice(1, -1))
            blended, alpha = surface.normals[inner], surface.alpha[inner].detach()
            agreement = (surface.depth_normals() * blended).sum(-1, keepdim=True)
            losses["normals"] = config.normal_weight * (alpha * (1 - agreement)).mean()
        return losses

    def view_metrics(self, context):
        """Mean angles in degrees of blended normals to those of the depth.

        Where the data has depth maps: to the normals of these, and the mean error of depth in the
        unit of the data.
        """
        batch, rendered = context.batch, context.rendered
        surface = Surface(rendered, batch.cameras)
        inner = (slice(1, -1), slice(1, -1))
        solid = surface.alpha[inner][..., 0] > SOLID
        blended, found = surface.normals[inner], {}
        found["normal_spread"] = _mean_angle(blended, surface.depth_normals(), solid)
        if (measured := batch.maps.get("depth")) is not None:
            known = measured.known[0, ..., 0].float()
            whole = torch.nn.functional.avg_pool2d(known[None], 3, 1)[0] > 0.99
            truth = normals_of(measured.values[0] * surface.rays)
            found["normal_error"] = _mean_angle(blended, truth, solid & whole)
            both = replace(measured, known=measured.known & (rendered.alpha > SOLID))
            error = (surface.depth()[None] - measured.values).abs()
            found["depth_error"] = float(both.mean(error)) * self.unit
        return found

    def view_images(self, context):
        """Blended normals, and those of the depth: red right, green up, blue to the camera."""
        surface = Surface(context.rendered, context.batch.cameras)
        of_depth = torch.nn.functional.pad(surface.depth_normals(), (0, 0, 1, 1, 1, 1))
        axes = surface.normals.new_tensor([1.0, -1.0, -1.0])
        return {
            "normals": (0.5 * surface.alpha + 0.5 * axes * surface.normals).clamp(0, 1),
            "depth_normals": (surface.alpha * (0.5 + 0.5 * axes * of_depth)).clamp(0, 1),
        }


def _mean_angle(first, second, where):
    """Mean angle between vectors in degrees over a mask; 0 without pixels."""
    cosines = cosine_similarity(first, second, dim=-1).clamp(-1, 1)
    angles = cosines.acos().rad2deg()[where]
    return float(angles.mean()) if len(angles) else 0.0
