"""Layers: what the pixels of some tiles see of their next ellipses, on the way there and back.

An ellipse is used in whitened form: alpha = o exp(-(u^2 + v^2) / 2) with u and v linear in the
pixel. They come out of one matrix product, q cannot be negative, and needles keep the digits that
the published form A x^2 + 2 B x y + C y^2 cancels.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.rasterizers.reference.bin import TILE
from gsfw.rasterizers.reference.project import Ellipses
from gsfw.rasterizers.reference.tile_buffer import Chunk, CutOffs, TileBuffer

SHAPE = 6
"""Columns of ``projected_splats`` that come before the channels."""


def projected_splats(ellipses: Ellipses, channels: Float[Tensor, "m d"]) -> Float[Tensor, "m f"]:
    """All that blending needs of each ellipse, differentiably, as rows of one matrix.

    x, y, r, k, w, opacity, then the channels. u = r dx and v = w (dy - k dx) are independent and
    have unit variance: r is 1 / deviation of x, w that of y where x is given, k the regression.
    """
    xx, xy, _ = ellipses.covariances.unbind(1)
    shape = [xx.rsqrt(), xy / xx, (xx / ellipses.determinants).sqrt(), ellipses.opacities]
    return torch.cat([ellipses.means, torch.stack(shape, dim=1), channels], dim=1)


def pixel_plane(like: Tensor) -> Float[Tensor, "3 p"]:
    """x, y and 1 at each pixel centre of a tile, measured from the middle of the tile."""
    steps = torch.arange(TILE, dtype=like.dtype, device=like.device) - 0.5 * (TILE - 1)
    x, y = steps.repeat(TILE), steps.repeat_interleave(TILE)
    return torch.stack([x, y, torch.ones_like(x)])


@dataclass(frozen=True)
class Layers:
    """A chunk as its pixels see it: t tiles, s slots, p pixels."""

    projected: Float[Tensor, "t s f"]
    """With x and y measured from the middle of the tile."""
    u: Float[Tensor, "t s p"]
    v: Float[Tensor, "t s p"]
    falloff: Float[Tensor, "t s p"]
    """exp(-(u^2 + v^2) / 2)."""
    raw: Float[Tensor, "t s p"]
    """Opacity times falloff: alpha before its cut-offs."""
    passing: Float[Tensor, "t s p"]
    """1 - alpha, kept one rounding above 0 so that what lies behind can be divided by it."""
    transmittance: Float[Tensor, "t s_plus_1 p"]
    """In front of each slot, and behind the last, as if blending never stopped."""
    weights: Float[Tensor, "t s p"]
    """Alpha times transmittance; 0 from the slot on that would bring the pixel to its stop."""

    def left(self, cut_offs: CutOffs) -> Float[Tensor, "t p"]:
        """Transmittance behind the last slot that was rendered; 1 where the pixel had stopped."""
        going_on = self.transmittance > cut_offs.transmittance_min
        return torch.where(going_on, self.transmittance, 1.0).amin(1)


def see(
    chunk: Chunk,
    buffer: TileBuffer,
    palette: Float[Tensor, "m_plus_1 f"],
    plane: Float[Tensor, "3 p"],
) -> Layers:
    """Evaluate a chunk.

    Args:
        chunk: what to evaluate.
        buffer: the image it is of.
        palette: the projected splats, and a row of zeros that the sentinel blends with: nothing.
        plane: ``pixel_plane``.
    """
    t, s = chunk.pairs.shape
    bins, cut_offs = buffer.bins, buffer.cut_offs
    seen = palette.index_select(0, bins.ellipses[chunk.pairs].view(-1)).view(t, s, -1)
    seen[:, :, :2] -= bins.middles[chunk.tiles, None]
    x, y, r, k, w, opacities = seen[:, :, :SHAPE].unbind(2)
    across = torch.stack([r, torch.zeros_like(r), -r * x], dim=2)
    along = torch.stack([-w * k, w, w * (k * x - y)], dim=2)
    u = (across.view(-1, 3) @ plane).view(t, s, -1)
    v = (along.view(-1, 3) @ plane).view(t, s, -1)
    falloff = (u * u).addcmul_(v, v).mul_(-0.5).exp_()
    raw = opacities[:, :, None] * falloff
    alpha = cut_offs.clamp(raw)
    passing = (1 - alpha).clamp_(min=torch.finfo(alpha.dtype).eps)
    transmittance = torch.cat([chunk.ahead[:, None], passing], dim=1).cumprod_(1)
    weights = cut_offs.stop(alpha.mul_(transmittance[:, :-1]), transmittance[:, 1:])
    return Layers(seen, u, v, falloff, raw, passing, transmittance, weights)
