"""Ray casting: images of the built-in scene through the camera model, without splats."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.datamanagers.synthetic.scene import SyntheticScene

SUBPIXELS = 4
"""Samples per pixel along each axis; a pixel is their mean, as a sensor's pixel is an area."""
MAX_RAYS = 1 << 17
"""Rays of a strip of rows, which bounds the memory of large images."""
TILE = 64
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


@contextmanager
def one_thread() -> Iterator[None]:
    """Cast rays in the calling thread alone.

    The work is many short operations, in each of which torch's threads would wait for one another
    (for seconds, where other programs use the cores too); and bits do not depend on their number.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def photograph(scene: SyntheticScene, camera: Cameras) -> UInt8[Tensor, "h w 4"]:
    """An image as a file would hold it: straight colours and coverage, 8 bits each."""
    rows = max(1, MAX_RAYS // (camera.width * SUBPIXELS**2))
    strips = [
        _strip(scene, camera, first, min(first + rows, camera.height))
        for first in range(0, camera.height, rows)
    ]
    premultiplied = torch.cat(strips, dim=1)
    alpha = premultiplied[3:]
    straight = premultiplied[:3] / alpha.clamp_min(1e-6)
    pixels = (torch.cat([straight, alpha]) * 255).round().to(torch.uint8)
    return pixels.permute(1, 2, 0).contiguous()


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
    steps = SUBPIXELS
    seen = torch.zeros(4, (last - first) * steps, camera.width * steps)
    footprints = _footprints(scene, camera)
    y = (torch.arange(first * steps, last * steps) + 0.5) / steps
    for left in range(0, camera.width, TILE):
        right = min(left + TILE, camera.width)
        near = frozenset(
            index
            for index, (x0, y0, x1, y1) in footprints.items()
            if x0 < right and left < x1 and y0 < last and first < y1
        )
        if near:
            x = (torch.arange(left * steps, right * steps) + 0.5) / steps
            grid_y, grid_x = torch.meshgrid(y, x, indexing="ij")
            origin, directions = rays(camera, torch.stack([grid_x, grid_y]).view(2, -1))
            hits = scene.trace(origin, directions, near)
            tile = seen[:, :, left * steps : right * steps]
            tile[:3] = scene.shade(hits, directions).view(3, len(y), len(x))
            tile[3] = (hits.solid >= 0).view(len(y), len(x))
    samples = seen.view(4, last - first, steps, camera.width, steps)
    # torch's mean over both dimensions is eight times slower.
    across = sum(samples.unbind(dim=4)[1:], start=samples[..., 0])
    return sum(across.unbind(dim=2)[1:], start=across[:, :, 0]) / steps**2
