"""Rays: the origin and direction of each pixel, in the scene frame."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras

TINY = 1e-12
"""Angles below this equal that of the optical axis."""


def pixel_rays(cameras: Cameras) -> Float[Tensor, "c h w 6"]:
    """Origin in scene units, then direction of length 1, for the centre of each pixel.

    Lens distortion is ignored: users of these rays only need to distinguish directions.
    """
    plane = _image_plane(cameras)
    axis = torch.ones_like(plane[..., :1])
    origins = torch.zeros_like(torch.cat([plane, axis], dim=-1))
    if cameras.model is CameraModel.ORTHOGRAPHIC:
        origins = torch.cat([plane, torch.zeros_like(axis)], dim=-1)
        directions = torch.cat([torch.zeros_like(plane), axis], dim=-1)
    elif cameras.model is CameraModel.FISHEYE:
        angle = plane.norm(dim=-1, keepdim=True)
        sideways = plane * (angle.sin() / angle.clamp_min(TINY))
        directions = torch.cat([sideways, angle.cos()], dim=-1)
    else:
        directions = torch.cat([plane, axis], dim=-1)
        directions = directions / directions.norm(dim=-1, keepdim=True)
    scene_from_camera = cameras.world_to_camera[:, None, :3, :3].transpose(-1, -2)
    centers = cameras.centers[:, None, None]
    return torch.cat(
        [_turned(scene_from_camera, origins) + centers, _turned(scene_from_camera, directions)],
        dim=-1,
    )


def _image_plane(cameras: Cameras) -> Float[Tensor, "c h w 2"]:
    """Pixel centres as x / z and y / z; angles where fisheye, scene units where orthographic."""
    like = cameras.intrinsics
    x = torch.arange(cameras.width, device=like.device, dtype=like.dtype) + 0.5
    y = torch.arange(cameras.height, device=like.device, dtype=like.dtype) + 0.5
    fx, fy = like[:, 0, 0, None, None], like[:, 1, 1, None, None]
    cx, cy = like[:, 0, 2, None, None], like[:, 1, 2, None, None]
    across = ((x[None, None, :] - cx) / fx).expand(-1, cameras.height, -1)
    down = ((y[None, :, None] - cy) / fy).expand(-1, -1, cameras.width)
    return torch.stack([across, down], dim=-1)


def _turned(
    rotations: Float[Tensor, "c 1 3 3"], vectors: Float[Tensor, "c h w 3"]
) -> Float[Tensor, "c h w 3"]:
    return vectors @ rotations.transpose(-1, -2)
