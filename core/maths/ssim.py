"""SSIM: the structural similarity of images, for the loss and the metric.

Wang et al. 2004 with the window of 3DGS: 11 x 11 Gaussian, sigma 1.5, zero padding, data range 1.
"""

from __future__ import annotations

from functools import lru_cache

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

WINDOW = 11
SIGMA = 1.5
C1 = 0.01**2
C2 = 0.03**2


@lru_cache(maxsize=8)
def _window(dtype: torch.dtype, device: torch.device) -> Tensor:
    offsets = torch.arange(WINDOW, dtype=torch.float64) - WINDOW // 2
    weights = torch.exp(-(offsets**2) / (2 * SIGMA**2))
    return (weights / weights.sum()).to(device=device, dtype=dtype)


def _blur(maps: Float[Tensor, "b 1 h w"]) -> Float[Tensor, "b 1 h w"]:
    window = _window(maps.dtype, maps.device)
    half = WINDOW // 2
    rows = functional.conv2d(maps, window.view(1, 1, -1, 1), padding=(half, 0))
    return functional.conv2d(rows, window.view(1, 1, 1, -1), padding=(0, half))


def ssim_map(
    rendered: Float[Tensor, "c h w d"], target: Float[Tensor, "c h w d"]
) -> Float[Tensor, "c h w d"]:
    """The similarity at every pixel and channel, in [-1, 1]."""
    c, h, w, d = rendered.shape
    x = rendered.permute(0, 3, 1, 2).reshape(c * d, 1, h, w)
    y = target.permute(0, 3, 1, 2).reshape(c * d, 1, h, w)
    mean_x, mean_y, xx, yy, xy = _blur(torch.cat([x, y, x * x, y * y, x * y])).chunk(5)
    mean_xx, mean_yy, mean_xy = mean_x * mean_x, mean_y * mean_y, mean_x * mean_y
    numerator = (2 * mean_xy + C1) * (2 * (xy - mean_xy) + C2)
    denominator = (mean_xx + mean_yy + C1) * (xx - mean_xx + yy - mean_yy + C2)
    return (numerator / denominator).view(c, d, h, w).permute(0, 2, 3, 1)


def masked_mean(values: Float[Tensor, "c h w d"], valid: Bool[Tensor, "c h w 1"] | None) -> Tensor:
    """Mean over the valid pixels; 0 if there are none."""
    if valid is None:
        return values.mean()
    weights = valid.to(values.dtype)
    return (values * weights).sum() / (weights.sum() * values.shape[-1]).clamp_min(1.0)


def ssim(
    rendered: Float[Tensor, "c h w d"],
    target: Float[Tensor, "c h w d"],
    valid: Bool[Tensor, "c h w 1"] | None = None,
) -> Float[Tensor, ""]:
    """Mean similarity over the valid pixels.

    Pixels that are not valid get the target's value first, so that they have no effect on the
    windows of their neighbours.
    """
    if valid is not None:
        rendered = torch.where(valid, rendered, target)
    return masked_mean(ssim_map(rendered, target), valid)
