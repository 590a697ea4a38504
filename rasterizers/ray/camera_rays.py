"""Eye: the rays of one camera in its own axes, and the tiles in which they are taken."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.maths.rays import pixel_rays

TILE = 16
"""Side of a tile in pixels: Gaussians that miss its rays are left out before they are evaluated."""


@dataclass(frozen=True)
class Rays:
    """``r`` rays in camera axes, where those of a perspective camera all begin at 0."""

    origins: Float[Tensor, "r 3"]
    directions: Float[Tensor, "r 3"]
    """Unit vectors; 0 for pixels that see no direction (beyond 180 degrees of a fisheye)."""
    pixels: Float[Tensor, "r 2"]
    """Centres of the pixels."""
    central: bool
    """True if rays begin at a centre; those of an orthographic camera reach back without end."""
    weights: Float[Tensor, "r 1"] | None = None
    """Weight of each ray in the contributions; ``None`` for ones."""

    def weigh(self, parts: Float[Tensor, "r m"]) -> Float[Tensor, " m"]:
        """Sum ``parts`` over the rays, each times the ray's weight."""
        return parts.sum(0) if self.weights is None else (parts * self.weights).sum(0)

    def select(self, rows: Int[Tensor, " s"]) -> Rays:
        """Some of them."""
        return replace(
            self,
            origins=self.origins.index_select(0, rows),
            directions=self.directions.index_select(0, rows),
            pixels=self.pixels.index_select(0, rows),
            weights=None if self.weights is None else self.weights.index_select(0, rows),
        )


def rays_of(camera: Cameras) -> Rays:
    """One ray through each pixel centre, row after row."""
    like = camera.intrinsics
    here = torch.eye(4, dtype=like.dtype, device=like.device)[None]
    origins, directions = (
        pixel_rays(replace(camera, world_to_camera=here))[0].view(-1, 6).split(3, 1)
    )
    x = torch.arange(camera.width, dtype=like.dtype, device=like.device) + 0.5
    y = torch.arange(camera.height, dtype=like.dtype, device=like.device) + 0.5
    pixels = torch.stack([x.repeat(camera.height), y.repeat_interleave(camera.width)], dim=1)
    if camera.model is CameraModel.FISHEYE:
        focal, principal = like[0].diagonal()[:2], like[0, :2, 2]
        angles = ((pixels - principal) / focal).norm(dim=1, keepdim=True)
        directions = torch.where(angles <= math.pi, directions, 0.0)
    return Rays(origins, directions, pixels, camera.model is not CameraModel.ORTHOGRAPHIC)


def tiles(camera: Cameras, device: torch.device) -> Iterator[Int[Tensor, " r"]]:
    """The rays of each tile of the image."""
    numbers = torch.arange(camera.width * camera.height, device=device)
    for rows in numbers.view(camera.height, camera.width).split(TILE):
        for tile in rows.split(TILE, dim=1):
            yield tile.reshape(-1)
