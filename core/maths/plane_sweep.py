"""Plane sweep: depth of each pixel from images of neighbouring cameras, and the surface points.

For each depth of a fixed set, neighbours are warped to the reference camera and compared in a
window (Collins 1996, "A Space-Sweep Approach to True Multi-Image Matching"; the mean of the best
neighbours, for occlusions, is that of Kang et al. 2001). Points whose depth two other cameras
confirm are kept, as in Galliani et al. 2015, "Gipuma", section 4.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample, pad

from gsfw.core.cameras import Cameras

PLANES = 96
"""Depths, at equal steps of their inverse."""
RADIUS = 2
"""Half of the window, in pixels."""
NEIGHBORS = 4
"""Nearest cameras that a camera is compared with."""
BEST_NEIGHBORS = 2
"""Those of them that have to agree; the others may not see the surface."""
COLOR_WEIGHT = 4.0
"""Weight of the mean absolute colour difference, which correlation alone does not see."""
LEAST_VARIANCE = 1e-3
"""Windows with less colour variance have no depth: every plane matches."""
LEAST_SCORE = 0.5
"""Least match of a pixel (1 is perfect). On garden_robot_mv at 200x150 it leaves 52,035 points, 0.6
leaves 37,593 and 0.8 leaves 10,402."""
TOLERANCE = 0.03
"""Cameras agree on a depth if the two differ by less, relatively."""
CONFIRMATIONS = 2
"""Other cameras that have to agree on a point's depth."""
OUTSIDE = -1.0
"""Score of a pixel that is not comparable."""


@dataclass(frozen=True)
class DepthImages:
    """Depth of every pixel of ``c`` cameras."""

    depths: Float[Tensor, "c h w"]
    """Along the axis of the camera, in scene units."""
    scores: Float[Tensor, "c h w"]
    """Match with the neighbours, 1 is perfect; -1 where there is no depth."""


@dataclass(frozen=True)
class _Windows:
    """Means and variances of windows of one image."""

    image: Float[Tensor, "1 3 h w"]
    mean: Float[Tensor, "1 3 h w"]
    variance: Float[Tensor, "1 1 h w"]

    @staticmethod
    def of(image: Float[Tensor, "1 3 h w"]) -> _Windows:
        mean = _window_mean(image)
        squares = _window_mean(image * image) - mean * mean
        return _Windows(image, mean, squares.sum(1, keepdim=True))

    def match(self, other: _Windows) -> Float[Tensor, "h w"]:
        """Normalised correlation minus the weighted difference of mean colours."""
        covariance = _window_mean(self.image * other.image) - self.mean * other.mean
        product = self.variance.clamp_min(1e-4) * other.variance.clamp_min(1e-4)
        difference = (self.mean - other.mean).abs().mean(1, keepdim=True)
        correlation = covariance.sum(1, keepdim=True) / product.sqrt()
        return (correlation - COLOR_WEIGHT * difference)[0, 0]


def plane_sweep(
    images: Float[Tensor, "c h w 3"], cameras: Cameras, near: float, far: float
) -> DepthImages:
    """Depths by comparison with the nearest cameras; at least two pinhole cameras of one time.

    Args:
        images: colours in [0, 1].
        cameras: cameras of the images.
        near: least depth, in scene units.
        far: largest depth.
    """
    planes = images.permute(0, 3, 1, 2)
    distances = torch.cdist(cameras.centers, cameras.centers)
    depths = 1.0 / torch.linspace(1.0 / near, 1.0 / far, PLANES)
    found = []
    for index in range(len(cameras)):
        others = [j for j in distances[index].argsort(stable=True).tolist() if j != index]
        found.append(_sweep_one(planes, cameras, index, others[:NEIGHBORS], depths))
    return DepthImages(*(torch.stack(list(each)) for each in zip(*found, strict=True)))


def _sweep_one(
    images: Float[Tensor, "c 3 h w"],
    cameras: Cameras,
    index: int,
    others: list[int],
    depths: Float[Tensor, " p"],
) -> tuple[Float[Tensor, "h w"], Float[Tensor, "h w"]]:
    reference = _Windows.of(images[index : index + 1])
    shape = images.shape[2:]
    best = torch.full(shape, OUTSIDE)
    chosen = depths[-1].expand(shape)
    for depth in depths:
        world = _unproject(cameras, index, depth.expand(shape))
        matches = []
        for other in others:
            grid, inside, _ = _project(cameras, other, world)
            warped = grid_sample(
                images[other : other + 1],
                grid.view(1, *shape, 2),
                padding_mode="border",
                align_corners=False,
            )
            match = reference.match(_Windows.of(warped))
            matches.append(torch.where(inside.view(shape), match, OUTSIDE))
        agreeing = min(BEST_NEIGHBORS, len(others))
        score = torch.stack(matches).topk(agreeing, dim=0).values.mean(0)
        chosen, best = torch.where(score > best, depth, chosen), score.maximum(best)
    return chosen, torch.where(reference.variance[0, 0] < LEAST_VARIANCE, OUTSIDE, best)


def confirmed_points(
    images: Float[Tensor, "c h w 3"], cameras: Cameras, found: DepthImages
) -> tuple[Float[Tensor, "p 3"], Float[Tensor, "p 3"]]:
    """Points on surfaces, and their colours: pixels whose depth enough other cameras confirm."""
    points, colors = [], []
    for index in range(len(cameras)):
        world = _unproject(cameras, index, found.depths[index])
        agreeing = torch.zeros(len(world), dtype=torch.int64)
        for other in range(len(cameras)):
            if other == index:
                continue
            grid, inside, depth = _project(cameras, other, world)
            there = _nearest(found.depths[other], grid)
            good = _nearest(found.scores[other], grid) > LEAST_SCORE
            agreeing += inside & good & ((there - depth).abs() < TOLERANCE * depth)
        kept = agreeing >= min(CONFIRMATIONS, len(cameras) - 1)
        kept &= found.scores[index].flatten() > LEAST_SCORE
        points.append(world[kept])
        colors.append(images[index].reshape(-1, 3)[kept])
    return torch.cat(points), torch.cat(colors)


def _unproject(cameras: Cameras, index: int, depth: Float[Tensor, "h w"]) -> Float[Tensor, "hw 3"]:
    """World positions of the pixel centres at a depth along the camera's axis."""
    rows, columns = torch.meshgrid(
        torch.arange(cameras.height) + 0.5, torch.arange(cameras.width) + 0.5, indexing="ij"
    )
    pixels = torch.stack([columns, rows, torch.ones_like(rows)], dim=-1).reshape(-1, 3)
    rays = pixels @ torch.linalg.inv(cameras.intrinsics[index]).T
    to_camera = cameras.world_to_camera[index]
    return (rays * depth.reshape(-1, 1) - to_camera[:3, 3]) @ to_camera[:3, :3]


def _project(
    cameras: Cameras, index: int, world: Float[Tensor, "p 3"]
) -> tuple[Float[Tensor, "p 2"], Bool[Tensor, " p"], Float[Tensor, " p"]]:
    """Image positions in [-1, 1], whether the image has them, and depths."""
    to_camera = cameras.world_to_camera[index]
    local = world @ to_camera[:3, :3].T + to_camera[:3, 3]
    depth = local[:, 2]
    pixels = local @ cameras.intrinsics[index].T
    grid = pixels[:, :2] / depth.clamp_min(1e-6)[:, None]
    grid = grid * (2.0 / torch.tensor([cameras.width, cameras.height])) - 1.0
    return grid, (grid.abs() < 1).all(1) & (depth > 0), depth


def _nearest(values: Float[Tensor, "h w"], grid: Float[Tensor, "p 2"]) -> Float[Tensor, " p"]:
    return grid_sample(values[None, None], grid[None, None], mode="nearest", align_corners=False)[
        0, 0, 0
    ]


def _window_mean(values: Float[Tensor, "1 d h w"]) -> Float[Tensor, "1 d h w"]:
    return avg_pool2d(pad(values, (RADIUS,) * 4, mode="replicate"), 2 * RADIUS + 1, stride=1)
