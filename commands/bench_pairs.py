"""Pairs: how many (pixel, splat) pairs take part in a picture, whichever rasterizer draws it."""

from __future__ import annotations

import torch

from gsfw.core.cameras import Cameras
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.reference.bin import bin_ellipses
from gsfw.rasterizers.reference.canvas import Canvas, CutOffs
from gsfw.rasterizers.reference.layers import brushes, pixel_plane, see
from gsfw.rasterizers.reference.measure import Measurements
from gsfw.rasterizers.reference.project import project, visible_extents

CHUNK_MB, PAIRS_MB = 4.0, 4096.0
"""Memory of the count, as the reference rasterizer has it by default."""


@torch.no_grad()
def contributing_pairs(splats: Splats, cameras: Cameras, settings: RenderSettings) -> int:
    """Count the pairs whose alpha is at least 1/255 and that are drawn before the pixel stops.

    The stages of the reference rasterizer decide, so that the count does not depend on what is
    measured; the pair that would bring the transmittance to 1e-4 is not drawn, and not counted.
    """
    views = [cameras.select(slice(index, index + 1)) for index in range(len(cameras))]
    return sum(_pairs(splats, camera, settings) for camera in views)


def _pairs(splats: Splats, camera: Cameras, settings: RenderSettings) -> int:
    everything = project(splats, camera, settings)
    visible, _ = visible_extents(everything, camera, settings)
    rows = visible.nonzero()[:, 0]
    rows = rows[everything.depths[rows].argsort(stable=True)]
    ellipses = project(splats, camera, settings, rows)
    bins = bin_ellipses(ellipses, camera, settings.profile, PAIRS_MB)
    canvas = Canvas(
        bins,
        bins.inside(camera),
        CutOffs.of(settings.profile, splats.means.dtype),
        CHUNK_MB,
        Measurements(rows, splats.means.new_ones(2), None, None, None),
    )
    shapes = brushes(ellipses, splats.means.new_zeros(len(rows), 0))
    palette = torch.cat([shapes, shapes.new_zeros(1, shapes.shape[1])])
    plane = pixel_plane(shapes)
    ahead = canvas.inside.clone()
    count = 0
    for chunk in canvas.chunks(ahead):
        layers = see(chunk, canvas, palette, plane)
        ahead[chunk.tiles] = layers.transmittance[:, -1]
        count += int(layers.weights.count_nonzero())
    return count
