"""Scene: the few splats, and the camera in front of them, that extremes are made of."""

from __future__ import annotations

import torch
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.splats import Sh, Splats


def random_splats(
    n: int, degree: int = 1, seed: int = 0, dtype: torch.dtype = torch.float32
) -> Splats:
    """Splats in a unit cube around the origin, in quats-and-scales form."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    def normal(*shape: int) -> Tensor:
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


def layers(count: int, opacity: float, channels: int = 1) -> Splats:
    """Splats of the same place and shape, one behind the other by their rows."""
    shades = torch.linspace(0, 1, count)[:, None]
    return Splats(
        means=torch.zeros(count, 3),
        opacities=torch.full((count,), opacity),
        colors=shades.repeat(1, channels),
        quats=torch.ones(count, 4),
        scales=torch.tensor([[1.0, 0.8, 0.6]]).repeat(count, 1),
    )
