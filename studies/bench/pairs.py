"""Pairs: how many (pixel, splat) pairs take part in an image, whichever rasterizer draws it."""

from __future__ import annotations

import torch

from gsfw.core.cameras import Cameras
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.reference.bin import bin_ellipses
from gsfw.rasterizers.reference.layers import pixel_plane, projected_splats, see
from gsfw.rasterizers.reference.project import project, visible_extents
from gsfw.rasterizers.reference.tile_buffer import CutOffs, Measurements, TileBuffer

MEMORY_MB = {"cpu": (4.0, 4096.0), "cuda": (64.0, 32768.0)}
"""Memory of a chunk of tiles and of the list of pairs: on the CPU those of the reference by
default; on a GPU more, where starting work is what takes time, and large scenes are drawn."""


@torch.no_grad()
def contributing_pairs(splats: Splats, cameras: Cameras, settings: RenderSettings) -> int:
    """Count the pairs whose alpha is at least 1/255 and that are drawn before the pixel stops.

    The stages of the reference rasterizer decide, so that the count does not depend on what is
    measured; the pair that would bring the transmittance to 1e-4 is not drawn, and not counted.
    """
    views = [cameras.select(slice(index, index + 1)) for index in range(len(cameras))]
    return sum(_pairs(splats, camera, settings) for camera in views)


def _pairs(splats: Splats, camera: Cameras, settings: RenderSettings) -> int:
    chunk_mb, pairs_mb = MEMORY_MB[splats.means.device.type]
    everything = project(splats, camera, settings)
    visible, _ = visible_extents(everything, camera, settings)
    rows = visible.nonzero()[:, 0]
    rows = rows[everything.depths[rows].argsort(stable=True)]
    ellipses = project(splats, camera, settings, rows)
    bins = bin_ellipses(ellipses, camera, settings.profile, pairs_mb)
    buffer = TileBuffer(
        bins,
        bins.inside(camera),
        CutOffs.of(settings.profile, splats.means.dtype),
        chunk_mb,
        Measurements(rows, splats.means.new_ones(2), None, None, None, None),
    )
    shapes = projected_splats(ellipses, splats.means.new_zeros(len(rows), 0))
    palette = torch.cat([shapes, shapes.new_zeros(1, shapes.shape[1])])
    plane = pixel_plane(shapes)
    ahead = buffer.inside.clone()
    count = 0
    for chunk in buffer.chunks(ahead):
        layers = see(chunk, buffer, palette, plane)
        ahead[chunk.tiles] = layers.transmittance[:, -1]
        count += int(layers.weights.count_nonzero())
    return count
