"""Blend: paint the ellipses of each tile over one another, from front to back.

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
from gsfw.rasterizers.reference.canvas import Canvas, Chunk
from gsfw.rasterizers.reference.layers import SHAPE, pixel_plane, see


def blend(
    brushes: Float[Tensor, "m f"], canvas: Canvas, camera: Cameras
) -> tuple[Float[Tensor, "h w d"], Float[Tensor, "h w 1"]]:
    """Paint an image with ``brushes``, which are sorted from front to back.

    Returns:
        The channels over zeros, and the transmittance that remains.
    """
    painted, left = _Blend.apply(brushes, canvas)
    tiles = torch.cat([painted, left[:, None]], dim=1)
    columns = canvas.bins.columns
    grid = tiles.view(-1, columns, tiles.shape[1], TILE, TILE).permute(0, 3, 1, 4, 2)
    image = grid.reshape(-1, columns * TILE, tiles.shape[1])[: camera.height, : camera.width]
    return image[:, :, :-1], image[:, :, -1:]


class _Blend(torch.autograd.Function):
    """[m, f] brushes -> [tiles, d, p] painted channels and [tiles, p] remaining transmittance."""

    @staticmethod
    def forward(ctx: Any, brushes: Tensor, canvas: Canvas) -> tuple[Tensor, Tensor]:  # noqa: ANN401
        tiles, channels = len(canvas.bins.counts), brushes.shape[1] - SHAPE
        palette = torch.cat([brushes, brushes.new_zeros(1, brushes.shape[1])])
        plane = pixel_plane(brushes)
        painted = brushes.new_zeros(tiles, channels, PIXELS)
        left = brushes.new_ones(tiles, PIXELS)
        measures = canvas.measurements.contribution is not None
        contributions = brushes.new_zeros(len(canvas.bins.ellipses), 1)
        ahead = canvas.inside.clone()
        chunks: list[Chunk] = []
        for chunk in canvas.chunks(ahead):
            layers = see(chunk, canvas, palette, plane)
            painted[chunk.tiles] += layers.brushes[:, :, SHAPE:].transpose(1, 2) @ layers.weights
            left[chunk.tiles] = torch.minimum(left[chunk.tiles], layers.left(canvas.cut_offs))
            ahead[chunk.tiles] = layers.transmittance[:, -1]
            if measures:
                contributions[chunk.pairs] = canvas.measurements.sum_weights(
                    chunk.tiles, layers.weights
                )[:, :, None]
            chunks.append(chunk)
        if measures:
            sums = canvas.bins.sum_by_ellipse(contributions)[:, 0]
            canvas.measurements.record_contribution(sums)
        ctx.save_for_backward(palette, left)
        ctx.canvas, ctx.chunks = canvas, chunks
        return painted, left

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, painted: Tensor, left: Tensor) -> tuple[Tensor, None]:  # noqa: ANN401
        palette, remaining = ctx.saved_tensors
        return blend_backward(palette, ctx.canvas, ctx.chunks, painted, left * remaining), None
