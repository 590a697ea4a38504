"""Ray casting: images of the built-in scene through the camera model, without splats."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.color_bytes import color_bytes
from gsfw.datamanagers.synthetic.scene import SyntheticScene

SUBPIXELS = 4
"""Samples per pixel along each axis where the image has an edge; such a pixel is their mean, as a
sensor's pixel is an area. Elsewhere one sample is enough (Whitted 1980)."""
EDGE = 1 / 16
"""Neighbouring pixels have an edge between them where their centres differ by more, in a colour or
in coverage. The images differ from those with ``SUBPIXELS`` everywhere by 66.8 dB of PSNR: by less
than rounding to 8 bits changes them (58.9 dB)."""
MAX_RAYS = 1 << 17
"""Rays of a strip of rows, which bounds the memory of large images."""
TILE = 160
"""Width in pixels of the blocks that a strip is cast in: only the solids near one are tried."""
MARGIN = 1.0
"""Pixels that a solid's footprint is widened by: far more than rounding can move a ray."""


def rays(
    camera: Cameras, pixels: Float[Tensor, "2 n"]
) -> tuple[Float[Tensor, "3 1"], Float[Tensor, "3 n"]]:
    """Origin and directions of the rays through positions in an image, in the camera's world.

    Args:
        camera: one pinhole camera.
        pixels: x and y in columns; the centre of the first pixel is (0.5, 0.5).

    Returns:
        Directions reach view depth 1, so that distances along them are depths.
    """
    matrix = camera.intrinsics[0].to(pixels)
    rotation = camera.world_to_camera[0, :3, :3].to(pixels)
    across = (pixels - matrix[:2, 2:]) / matrix.diagonal()[:2, None]
    ahead = torch.cat([across, torch.ones_like(across[:1])])
    return camera.centers.to(pixels).T, rotation.T @ ahead


def project(camera: Cameras, points: Float[Tensor, "3 n"]) -> Float[Tensor, "2 n"]:
    """Positions of points in the image, in pixels."""
    pose = camera.world_to_camera[0].to(points)
    seen = pose[:3, :3] @ points + pose[:3, 3:]
    matrix = camera.intrinsics[0].to(points)
    return seen[:2] / seen[2] * matrix.diagonal()[:2, None] + matrix[:2, 2:]


def photograph(scene: SyntheticScene, camera: Cameras) -> UInt8[Tensor, "h w 4"]:
    """An image as a file would hold it: straight colours and coverage, 8 bits each."""
    rows = max(1, MAX_RAYS // camera.width)
    strips = [
        _strip(scene, camera, first, min(first + rows, camera.height))
        for first in range(0, camera.height, rows)
    ]
    premultiplied = torch.cat(strips, dim=1)
    alpha = premultiplied[3:]
    straight = premultiplied[:3] / alpha.clamp_min(1e-6)
    return color_bytes(torch.cat([straight, alpha]).permute(1, 2, 0)).contiguous()


def show_change(scenes: Sequence[SyntheticScene], camera: Cameras) -> Bool[Tensor, "h w 1"]:
    """The pixels whose centre shows a solid that changes over time, in any of the scenes.

    Not only where such a solid is now: also where it has been or will be. Its shadow and its
    mirror image do not count.
    """
    y, x = torch.arange(camera.height) + 0.5, torch.arange(camera.width) + 0.5
    grid_y, grid_x = torch.meshgrid(y, x, indexing="ij")
    origin, directions = rays(camera, torch.stack([grid_x, grid_y]).view(2, -1))
    shown = torch.zeros_like(directions[0], dtype=torch.bool)
    for scene in scenes:
        # The last entry answers for rays that meet nothing, whose index is -1.
        changes = torch.tensor([*(solid.changes for solid in scene.solids), False])
        shown |= changes[scene.trace(origin, directions).solid]
    return shown.view(camera.height, camera.width, 1)


def _footprints(
    scene: SyntheticScene, camera: Cameras
) -> dict[int, tuple[float, float, float, float]]:
    """Pixels [x0, x1) x [y0, y1) outside of which no ray meets a solid, by the solid's index."""
    footprints = {}
    everywhere = (-math.inf, -math.inf, math.inf, math.inf)
    for index, _, pose in scene.placed:
        corners = pose.corners()
        pose_rows = camera.world_to_camera[0].to(corners)
        depth = pose_rows[2, :3] @ corners + pose_rows[2, 3]
        pixels = project(camera, corners)
        low, high = pixels.amin(dim=1) - MARGIN, pixels.amax(dim=1) + MARGIN
        ahead = bool((depth > 0).all())
        footprints[index] = (*low.tolist(), *high.tolist()) if ahead else everywhere
    return footprints


def _strip(scene: SyntheticScene, camera: Cameras, first: int, last: int) -> Float[Tensor, "4 r w"]:
    """Rows of an image: mean colour times coverage, and mean coverage, of each pixel."""
    # One row more on each side: an edge along the border of a strip is seen from both strips.
    above, below = max(first - 1, 0), min(last + 1, camera.height)
    near = _tiles(scene, camera, above, below)
    seen = torch.zeros(4, below - above, camera.width)
    for left, solids in near.items():
        right = min(left + TILE, camera.width)
        pixels = torch.cartesian_prod(torch.arange(above, below), torch.arange(left, right)).T
        centers = _cast(scene, camera, solids, pixels, 1)
        seen[:, :, left:right] = centers.view(4, below - above, right - left)
    edges = _edges(seen)
    for left, solids in near.items():
        found = edges[:, left : left + TILE].nonzero().T
        for y, x in found.split(MAX_RAYS // SUBPIXELS**2, dim=1):
            pixels = torch.stack([y + above, x + left])
            seen[:, y, x + left] = _cast(scene, camera, solids, pixels, SUBPIXELS)
    return seen[:, first - above : last - above]


def _tiles(
    scene: SyntheticScene, camera: Cameras, first: int, last: int
) -> dict[int, frozenset[int]]:
    """Indices of the solids near each tile of some rows that has any, by its first column."""
    footprints = _footprints(scene, camera)
    tiles = {
        left: frozenset(
            index
            for index, (x0, y0, x1, y1) in footprints.items()
            if x0 < left + TILE and left < x1 and y0 < last and first < y1
        )
        for left in range(0, camera.width, TILE)
    }
    return {left: solids for left, solids in tiles.items() if solids}


def _cast(
    scene: SyntheticScene,
    camera: Cameras,
    near: frozenset[int],
    pixels: Int[Tensor, "2 n"],
    steps: int,
) -> Float[Tensor, "4 n"]:
    """Mean colour and coverage of pixels (row and column), from ``steps`` squared samples each."""
    offsets = (torch.arange(steps) + 0.5) / steps
    x = pixels[1] + offsets.repeat(steps)[:, None]
    y = pixels[0] + offsets.repeat_interleave(steps)[:, None]
    origin, directions = rays(camera, torch.stack([x, y]).flatten(1))
    hits = scene.trace(origin, directions, near)
    colors = scene.shade(hits, directions)
    samples = torch.cat([colors, (hits.solid >= 0)[None].to(colors)]).view(4, steps**2, -1)
    # torch's mean over a dimension inside is several times slower.
    return sum(samples.unbind(1)[1:], start=samples[:, 0]) / steps**2


def _edges(seen: Float[Tensor, "4 r w"]) -> Bool[Tensor, "r w"]:
    """Pixels that differ by more than ``EDGE`` from one beside, above or below them."""
    edges = torch.zeros(seen.shape[1:], dtype=torch.bool)
    across = (seen[:, :, 1:] - seen[:, :, :-1]).abs().amax(dim=0) > EDGE
    down = (seen[:, 1:] - seen[:, :-1]).abs().amax(dim=0) > EDGE
    edges[:, 1:] |= across
    edges[:, :-1] |= across
    edges[1:] |= down
    edges[:-1] |= down
    return edges
