"""Blend, backward: from the gradient of an image to that of its projected splats.

The chunks are taken from back to front and evaluated again, so that only what lies behind has to be
carried. With w = alpha T and p = d loss / d w, alpha's gradient is T p less what it hides, which is
the sum of w p behind it over 1 - alpha. Transmittance is replayed from the front; the published
code recovers it from the back by division, which loses precision.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.rasterizers.reference.layers import SHAPE, Layers, pixel_plane, see
from gsfw.rasterizers.reference.tile_buffer import Chunk, CutOffs, TileBuffer


def blend_backward(
    palette: Float[Tensor, "m_plus_1 f"],
    buffer: TileBuffer,
    chunks: list[Chunk],
    blended: Float[Tensor, "tiles d p"],
    behind: Float[Tensor, "tiles p"],
) -> Float[Tensor, "m f"]:
    """The gradient of the projected splats; records the gradient statistics on the way.

    Args:
        palette: the projected splats of the forward pass, and a row of zeros.
        buffer: of the forward pass.
        chunks: of the forward pass.
        blended: gradient of the blended channels.
        behind: remaining transmittance times its gradient.
    """
    plane = pixel_plane(palette)
    behind = behind.clone()
    measurements = buffer.measurements
    wants_absolute = measurements.absgrad is not None
    features = palette.shape[1]
    pairs = palette.new_zeros(len(buffer.bins.ellipses), features + 2 * wants_absolute)
    for chunk in reversed(chunks):
        layers = see(chunk, buffer, palette, plane)
        image = blended[chunk.tiles]
        pulls = layers.projected[:, :, SHAPE:] @ image
        hidden = layers.weights * pulls
        alphas = _alpha_gradient(layers, buffer.cut_offs, pulls, hidden, behind[chunk.tiles])
        behind[chunk.tiles] += hidden.sum(1)
        shape, absolute = _shape_gradient(layers, alphas, plane, wants_absolute)
        parts = [shape, layers.weights @ image.transpose(1, 2), *absolute]
        pairs[chunk.pairs] = torch.cat(parts, dim=2)
    gradient = buffer.bins.sum_by_ellipse(pairs)
    absolute_sums = gradient[:, features:] if wants_absolute else None
    measurements.record_gradients(gradient[:, :2], absolute_sums)
    return gradient[:, :features]


def _alpha_gradient(
    layers: Layers,
    cut_offs: CutOffs,
    pulls: Float[Tensor, "t s p"],
    hidden: Float[Tensor, "t s p"],
    behind: Float[Tensor, "t p"],
) -> Float[Tensor, "t s p"]:
    """The gradient of opacity times falloff: 0 where a cut-off has the say.

    Args:
        layers: the chunk.
        cut_offs: of the image.
        pulls: d loss / d weight of each slot.
        hidden: weights times pulls.
        behind: what the slots after this chunk, and the remaining transmittance, add to that.
    """
    slots = hidden.shape[1]
    # Summing what is behind by a product adds it up from small numbers; subtracting what is in
    # front from the total would lose the digits of the last slots.
    after = torch.ones(slots, slots, dtype=hidden.dtype, device=hidden.device).triu(1)
    hides = (after @ hidden).add_(behind[:, None]).div_(layers.passing)
    gradient = (layers.transmittance[:, :-1] * pulls).sub_(hides)
    gradient = cut_offs.stop(gradient, layers.transmittance[:, 1:])
    return cut_offs.clamp_gradient(gradient, layers.raw)


def _shape_gradient(
    layers: Layers, alphas: Float[Tensor, "t s p"], plane: Float[Tensor, "3 p"], absolute: bool
) -> tuple[Float[Tensor, "t s 6"], list[Float[Tensor, "t s 2"]]]:
    """Gradients of x, y, r, k, w and opacity; if asked for, of x and y in magnitudes as well."""
    t, s, pixels = alphas.shape
    x, y, r, k, w, opacities = layers.projected[:, :, :SHAPE].unbind(2)
    falloffs = alphas.mul_(layers.falloff)
    # From here on gradients are those of u and v, which are linear in the pixel: u = a . plane.
    swings = falloffs * -opacities[:, :, None]
    u, v = swings * layers.u, swings * layers.v
    u_x, _, u_1 = (u.view(-1, pixels) @ plane.T).view(t, s, 3).unbind(2)
    v_x, v_y, v_1 = (v.view(-1, pixels) @ plane.T).view(t, s, 3).unbind(2)
    columns = [
        w * k * v_1 - r * u_1,
        -w * v_1,
        u_x - x * u_1,
        -w * (v_x - x * v_1),
        v_y - k * v_x + (k * x - y) * v_1,
        falloffs.sum(2),
    ]
    shape = torch.stack(columns, dim=2)
    if not absolute:
        return shape, []
    across = (v * (w * k)[:, :, None]).addcmul_(u, r[:, :, None], value=-1).abs_().sum(2)
    return shape, [torch.stack([across, v.abs_().sum(2) * w], dim=2)]
