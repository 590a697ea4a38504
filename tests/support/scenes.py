"""Small scenes that several tests draw."""

from dataclasses import replace

import torch

from gsfw.core.cameras import CameraModel
from gsfw.studies.stress.case import front_camera, random_splats

__all__ = ["front_camera", "random_splats", "turned_camera"]


def turned_camera(model: CameraModel = CameraModel.PINHOLE):
    """A camera that looks at the origin from the side, and whose centre is not in the middle."""
    camera = front_camera(dtype=torch.float64)
    generator = torch.Generator().manual_seed(4)
    turn = torch.linalg.qr(torch.randn(3, 3, generator=generator, dtype=torch.float64))[0]
    pose = camera.world_to_camera.clone()
    pose[0, :3, :3] = turn * turn.det()
    intrinsics = camera.intrinsics.clone()
    intrinsics[0, :2, 2] += torch.tensor([3.0, -2.0])
    if model is CameraModel.ORTHOGRAPHIC:
        intrinsics[0, [0, 1], [0, 1]] = 10.0
    return replace(camera, world_to_camera=pose, intrinsics=intrinsics, model=model)
