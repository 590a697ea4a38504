"""Blend: blend the ellipses of each tile over one another, from front to back.

Kerbl et al. 2023, equation 3. All tiles advance together, a few slots at a time: memory is bounded
by the chunk, and tiles that have become opaque drop out. Backward evaluates every chunk again.
"""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from gsfw.core.cameras import Cameras
from gsfw.rasterizers.reference.bin import PIXELS, TILE
from gsfw.rasterizers.reference.blend_backward import blend_backward
from gsfw.rasterizers.reference.layers import SHAPE, pixel_plane, see
from gsfw.rasterizers.reference.tile_buffer import Chunk, TileBuffer


def blend(
    projected: Float[Tensor, "m f"], buffer: TileBuffer, camera: Cameras
) -> tuple[Float[Tensor, "h w d"], Float[Tensor, "h w 1"]]:
    """Blend the projected splats, sorted from front to back, into an image.

    Returns:
        The channels over zeros, and the transmittance that remains.
    """
    blended, left = _Blend.apply(projected, buffer)
    tiles = torch.cat([blended, left[:, None]], dim=1)
    columns = buffer.bins.columns
    grid = tiles.view(-1, columns, tiles.shape[1], TILE, TILE).permute(0, 3, 1, 4, 2)
    image = grid.reshape(-1, columns * TILE, tiles.shape[1])[: camera.height, : camera.width]
    return image[:, :, :-1], image[:, :, -1:]


class _Blend(torch.autograd.Function):
    """From [m, f] projected splats to [tiles, d, p] channels and [tiles, p] transmittance."""

    @staticmethod
    def forward(ctx: Any, projected: Tensor, buffer: TileBuffer) -> tuple[Tensor, Tensor]:  # noqa: ANN401
        tiles, channels = len(buffer.bins.counts), projected.shape[1] - SHAPE
        palette = torch.cat([projected, projected.new_zeros(1, projected.shape[1])])
        plane = pixel_plane(projected)
        blended = projected.new_zeros(tiles, channels, PIXELS)
        left = projected.new_ones(tiles, PIXELS)
        measures = buffer.measurements.contribution is not None
        contributions = projected.new_zeros(len(buffer.bins.ellipses), 1)
        ahead = buffer.inside.clone()
        chunks: list[Chunk] = []
        for chunk in buffer.chunks(ahead):
            layers = see(chunk, buffer, palette, plane)
            blended[chunk.tiles] += layers.projected[:, :, SHAPE:].transpose(1, 2) @ layers.weights
            left[chunk.tiles] = torch.minimum(left[chunk.tiles], layers.left(buffer.cut_offs))
            ahead[chunk.tiles] = layers.transmittance[:, -1]
            if measures:
                contributions[chunk.pairs] = buffer.measurements.sum_weights(
                    chunk.tiles, layers.weights
                )[:, :, None]
            chunks.append(chunk)
        if measures:
            sums = buffer.bins.sum_by_ellipse(contributions)[:, 0]
            buffer.measurements.record_contribution(sums)
        ctx.save_for_backward(palette, left)
        ctx.buffer, ctx.chunks = buffer, chunks
        return blended, left

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, blended: Tensor, left: Tensor) -> tuple[Tensor, None]:  # noqa: ANN401
        palette, remaining = ctx.saved_tensors
        return blend_backward(palette, ctx.buffer, ctx.chunks, blended, left * remaining), None
