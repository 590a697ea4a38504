"""Small scenes that several tests draw."""

from dataclasses import replace

import torch

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.splats import Sh, Splats


def random_splats(
    n: int, degree: int = 1, seed: int = 0, dtype: torch.dtype = torch.float32
) -> Splats:
    """Splats in a unit cube around the origin, in quats-and-scales form."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    return Splats(
        means=(2 * uniform(n, 3) - 1).to(dtype),
        opacities=(0.1 + 0.85 * uniform(n)).to(dtype),
        colors=Sh((0.4 * normal(n, (degree + 1) ** 2, 3)).to(dtype), degree),
        quats=normal(n, 4).to(dtype),
        scales=(0.02 + 0.15 * uniform(n, 3)).to(dtype),
    )


def front_camera(
    width: int = 40, height: int = 30, distance: float = 4.0, dtype: torch.dtype = torch.float32
) -> Cameras:
    """One pinhole camera that looks along +z at the origin."""
    world_to_camera = torch.eye(4, dtype=torch.float64)
    world_to_camera[2, 3] = distance
    intrinsics = torch.tensor(
        [[1.2 * width, 0.0, width / 2], [0.0, 1.2 * width, height / 2], [0.0, 0.0, 1.0]],
        dtype=torch.float64,
    )
    return Cameras(world_to_camera[None].to(dtype), intrinsics[None].to(dtype), width, height)


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
