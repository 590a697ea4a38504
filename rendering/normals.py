"""Normals: the directions of the surface that a depth image shows."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import torch

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.maths.rays import pixel_rays

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

NAN = float("nan")


def surface_normals(depth: Float[Tensor, "h w"], camera: Cameras) -> Float[Tensor, "h w 3"]:
    """Unit normals of a depth image in the axes of its camera, towards the camera.

    They are the cross products of the central differences of the points; NaN where a neighbour
    has no depth.
    """
    points = camera_points(depth, camera)
    padded = torch.nn.functional.pad(points, (0, 0, 1, 1, 1, 1), value=NAN)
    across = _difference(padded[1:-1, 2:], points, padded[1:-1, :-2])
    down = _difference(padded[2:, 1:-1], points, padded[:-2, 1:-1])
    normals = torch.linalg.cross(down, across)
    return normals / normals.norm(dim=2, keepdim=True).clamp_min(1e-30)


def _difference(after: Tensor, here: Tensor, before: Tensor) -> Tensor:
    """Central difference, or that to one side where the other one is unknown."""
    forward, backward = after - here, here - before
    central = (forward + backward) / 2
    known = torch.where(forward.isfinite(), forward, backward)
    return torch.where(central.isfinite(), central, known)


def camera_points(depth: Float[Tensor, "h w"], camera: Cameras) -> Float[Tensor, "h w 3"]:
    """The point of each pixel in camera axes, scene units; NaN where the depth is."""
    here = torch.eye(4, dtype=depth.dtype, device=depth.device)[None]
    rays = pixel_rays(replace(camera, world_to_camera=here))[0].to(depth)
    origins, directions = rays[..., :3], rays[..., 3:]
    if camera.model is CameraModel.ORTHOGRAPHIC:
        return origins + directions * depth[..., None]
    along = directions[..., 2:]
    return directions * (depth[..., None] / torch.where(along > 1e-6, along, NAN))
