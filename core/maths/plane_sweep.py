"""Plane sweep: depth of each pixel from images of neighbouring cameras, and the surface points.

For each depth of a fixed set, neighbours are warped to the reference camera and compared in a
window (Collins 1996, "A Space-Sweep Approach to True Multi-Image Matching"; the mean of the best
neighbours, for occlusions, is that of Kang et al. 2001). Semi-global matching then chooses depths
that neighbouring pixels agree on. Points whose depth two other cameras confirm are kept, as in
Galliani et al. 2015, "Gipuma", section 4.4. Pixels of the background's colour show no surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample, pad

from gsfw.core.cameras import Cameras
from gsfw.core.maths.semi_global import aggregate, best_plane

PLANES = 96
"""Depths, at equal steps of their inverse."""
RADIUS = 1
"""Half of the window, in pixels."""
NEIGHBORS = 4
"""Nearest cameras that a camera is compared with."""
BEST_NEIGHBORS = 2
"""Those of them that have to agree; the others may not see the surface."""
LARGEST_DIFFERENCE = 0.25
"""Mean colour differences above this count as this: what is hidden is no worse than wrong."""
LEAST_SCORE = 0.55
"""Least match of a pixel (1 is perfect)."""
LEAST_CONTRAST = 0.02
"""Least cost of a mean plane above the best one's; with less, every plane matches."""
TOLERANCE = 0.03
"""Cameras agree on a depth if the two differ by less, relatively."""
CONFIRMATIONS = 2
"""Other cameras that have to agree on a point's depth."""
CONTRADICTIONS = 1
"""Other cameras that may show background in place of a point: reflections look like it."""
BACKGROUND_TOLERANCE = 0.015
"""Largest difference of a channel from the background's colour; JPEG changes it by less."""
OUTSIDE = -1.0
"""Score of a pixel without depth."""


@dataclass(frozen=True)
class DepthImages:
    """Depth of every pixel of ``c`` cameras."""

    depths: Float[Tensor, "c h w"]
    """Along the axis of the camera, in scene units."""
    scores: Float[Tensor, "c h w"]
    """Match with the neighbours, 0 to 1 (perfect); -1 where there is no depth."""
    empty: Bool[Tensor, "c h w"]
    """Pixels of the background's colour."""


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

    def cost(self, other: _Windows) -> Float[Tensor, "h w"]:
        """Half of it the colour difference, half of it 1 - normalised correlation; 0 to 1."""
        difference = (self.image - other.image).abs().mean(1, keepdim=True)
        difference = _window_mean(difference.clamp_max(LARGEST_DIFFERENCE)) / LARGEST_DIFFERENCE
        covariance = _window_mean(self.image * other.image) - self.mean * other.mean
        product = self.variance.clamp_min(1e-4) * other.variance.clamp_min(1e-4)
        correlation = covariance.sum(1, keepdim=True) / product.sqrt()
        return (0.5 * difference + 0.25 * (1.0 - correlation.clamp(-1, 1)))[0, 0]


def plane_sweep(
    images: Float[Tensor, "c h w 3"],
    cameras: Cameras,
    near: float,
    far: float,
    background: Float[Tensor, " 3"],
) -> DepthImages:
    """Depths by comparison with the nearest cameras; at least two pinhole cameras of one time.

    Args:
        images: colours in [0, 1].
        cameras: cameras of the images.
        near: least depth, in scene units.
        far: largest depth.
        background: colour of empty pixels, in [0, 1].
    """
    planes = images.permute(0, 3, 1, 2)
    distances = torch.cdist(cameras.centers, cameras.centers)
    inverse = torch.linspace(1.0 / near, 1.0 / far, PLANES)
    empty = ((images - background).abs() < BACKGROUND_TOLERANCE).all(3)
    depths, scores = [], []
    for index in range(len(cameras)):
        others = [j for j in distances[index].argsort(stable=True).tolist() if j != index]
        costs = _costs(planes, cameras, index, others[:NEIGHBORS], 1.0 / inverse)
        smooth = aggregate(costs, images[index])
        chosen = best_plane(smooth)
        depths.append(1.0 / torch.lerp(inverse[0], inverse[-1], chosen / (PLANES - 1)))
        score = 1.0 - costs.gather(0, chosen.round().long()[None])[0]
        flat = smooth.mean(0) - smooth.amin(0) < LEAST_CONTRAST
        scores.append(torch.where(flat | empty[index], OUTSIDE, score))
    return DepthImages(torch.stack(depths), torch.stack(scores), empty)


def _costs(
    images: Float[Tensor, "c 3 h w"],
    cameras: Cameras,
    index: int,
    others: list[int],
    depths: Float[Tensor, " p"],
) -> Float[Tensor, "p h w"]:
    """Mean cost of the best neighbours at each depth; 1 where too few of them see the place."""
    reference = _Windows.of(images[index : index + 1])
    shape = images.shape[2:]
    agreeing = min(BEST_NEIGHBORS, len(others))
    found = []
    for depth in depths:
        world = _unproject(cameras, index, depth.expand(shape))
        costs = []
        for other in others:
            grid, inside, _ = _project(cameras, other, world)
            warped = grid_sample(
                images[other : other + 1],
                grid.view(1, *shape, 2),
                padding_mode="border",
                align_corners=False,
            )
            cost = reference.cost(_Windows.of(warped))
            costs.append(torch.where(inside.view(shape), cost, 1.0))
        found.append(torch.stack(costs).topk(agreeing, dim=0, largest=False).values.mean(0))
    return torch.stack(found)


def confirmed_points(
    images: Float[Tensor, "c h w 3"], cameras: Cameras, found: DepthImages
) -> tuple[Float[Tensor, "p 3"], Float[Tensor, "p 3"]]:
    """Points on surfaces, and their colours: pixels whose depth enough other cameras confirm."""
    points, colors = [], []
    for index in range(len(cameras)):
        world = _unproject(cameras, index, found.depths[index])
        agreeing = torch.zeros(len(world), dtype=torch.int64)
        contradicting = torch.zeros_like(agreeing)
        for other in range(len(cameras)):
            if other == index:
                continue
            grid, inside, depth = _project(cameras, other, world)
            there = _nearest(found.depths[other], grid)
            good = _nearest(found.scores[other], grid) > LEAST_SCORE
            agreeing += inside & good & ((there - depth).abs() < TOLERANCE * depth)
            contradicting += inside & (_nearest(found.empty[other].float(), grid) > 0.5)
        kept = agreeing >= min(CONFIRMATIONS, len(cameras) - 1)
        kept &= found.scores[index].flatten() > LEAST_SCORE
        kept &= contradicting <= CONTRADICTIONS
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
