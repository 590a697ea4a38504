"""Images of pinhole cameras as stereo compares them, and the geometry of their pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Bool, Float, Float64
from torch import Tensor
from torch.nn.functional import interpolate

LUMA = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in grey (BT.601)."""
LEAST_DEPTH = 1e-9
"""Depths below this, in scene units, count as this in a division."""


@dataclass(frozen=True)
class StereoViews:
    """``v`` images of one instant, with their cameras; sizes may differ."""

    colors: tuple[Float[Tensor, "_ _ 3"], ...]
    """In [0, 1]."""
    world_to_camera: Float64[Tensor, "v 4 4"]
    """Rigid, OpenCV axes."""
    intrinsics: Float64[Tensor, "v 3 3"]
    """In pixels of these images."""
    empty: tuple[Bool[Tensor, "_ _"], ...]
    """Pixels that show background: no surface is there, nor in front of it."""
    unknown: tuple[Bool[Tensor, "_ _"], ...]
    """Pixels outside of masks: nothing is known about them."""

    def __len__(self) -> int:
        return len(self.colors)

    @cached_property
    def grey(self) -> tuple[Float[Tensor, "_ _"], ...]:
        """Brightness of every pixel, in [0, 1]."""
        return tuple((image * torch.tensor(LUMA)).sum(2) for image in self.colors)

    @cached_property
    def centers(self) -> Float64[Tensor, "v 3"]:
        """Camera positions."""
        rotation, translation = self.world_to_camera[:, :3, :3], self.world_to_camera[:, :3, 3:]
        return -(rotation.transpose(1, 2) @ translation)[:, :, 0]

    @property
    def pixels(self) -> int:
        """Pixels of all images."""
        return sum(image.shape[0] * image.shape[1] for image in self.colors)

    def size(self, view: int) -> tuple[int, int]:
        """Height and width of an image."""
        return self.colors[view].shape[0], self.colors[view].shape[1]

    def shrunk(self, pixels: int) -> StereoViews:
        """The same views with at most about ``pixels`` pixels each."""
        factors = [min(1.0, (pixels / (h * w)) ** 0.5) for h, w in map(self.size, range(len(self)))]
        sizes = [
            (max(2, round(factor * h)), max(2, round(factor * w)))
            for factor, (h, w) in zip(factors, map(self.size, range(len(self))), strict=True)
        ]
        intrinsics = self.intrinsics.clone()
        for view, (height, width) in enumerate(sizes):
            intrinsics[view, 0] *= width / self.colors[view].shape[1]
            intrinsics[view, 1] *= height / self.colors[view].shape[0]
        return replace(
            self,
            colors=tuple(map(area_mean, self.colors, sizes)),
            intrinsics=intrinsics,
            empty=tuple(_half(each, size) for each, size in zip(self.empty, sizes, strict=True)),
            unknown=tuple(_half(each, s) for each, s in zip(self.unknown, sizes, strict=True)),
        )

    def project(
        self, view: int, places: Float64[Tensor, "p 3"]
    ) -> tuple[Float64[Tensor, "p 2"], Float64[Tensor, " p"], Bool[Tensor, " p"]]:
        """Pixel positions, depths, and whether the image has them."""
        pose, (height, width) = self.world_to_camera[view], self.size(view)
        local = places @ pose[:3, :3].T + pose[:3, 3]
        depths = local[:, 2]
        pixels = (local @ self.intrinsics[view].T)[:, :2] / depths.clamp_min(LEAST_DEPTH)[:, None]
        limits = torch.tensor([width, height])
        return pixels, depths, (depths > 0) & ((pixels >= 0) & (pixels < limits)).all(1)

    def visible(self, places: Float64[Tensor, "p 3"]) -> Bool[Tensor, "v p"]:
        """True if an image has a place, as if there were nothing in front of it."""
        local = places @ self.world_to_camera[:, :3, :3].mT + self.world_to_camera[:, None, :3, 3]
        pixels = local @ self.intrinsics.mT
        at = pixels[..., :2] / pixels[..., 2:].clamp_min(LEAST_DEPTH)
        limits = torch.tensor([self.size(view)[::-1] for view in range(len(self))])[:, None]
        return (local[..., 2] > 0) & ((at >= 0) & (at < limits)).all(2)

    def unproject(
        self, view: int, pixels: Float64[Tensor, "p 2"], depths: Float64[Tensor, " p"]
    ) -> Float64[Tensor, "p 3"]:
        """Places at pixel positions and depths along the camera's axis."""
        rays = torch.cat([pixels, torch.ones_like(pixels[:, :1])], dim=1)
        local = rays @ torch.linalg.inv(self.intrinsics[view]).T * depths[:, None]
        pose = self.world_to_camera[view]
        return (local - pose[:3, 3]) @ pose[:3, :3]

    def pixel_centers(self, view: int) -> Float64[Tensor, "p 2"]:
        """Positions of all pixels of a view, row by row."""
        height, width = self.size(view)
        rows, columns = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
        return torch.stack([columns, rows], dim=-1).reshape(-1, 2).double() + 0.5


def area_mean(image: Float[Tensor, "_ _ d"], size: tuple[int, int]) -> Float[Tensor, "_ _ d"]:
    """An image at another size, height first, by area."""
    return interpolate(image.permute(2, 0, 1)[None], size, mode="area")[0].permute(1, 2, 0)


def _half(flags: Bool[Tensor, "_ _"], size: tuple[int, int]) -> Bool[Tensor, "_ _"]:
    """Flags at a smaller size, set where at least half of them were."""
    return area_mean(flags.float()[:, :, None], size)[:, :, 0] >= 0.5
