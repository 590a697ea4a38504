"""The interface of fused-ssim, which trainers of 3DGS import for their loss."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.api import ssim_map
from gsfw.compat.refusal import refuse

RADIUS = 5
"""Half the side of the window, in pixels."""


def fused_ssim(
    img1: Float[Tensor, "b d h w"],
    img2: Float[Tensor, "b d h w"],
    padding: str = "same",
    train: bool = True,
) -> Float[Tensor, ""]:
    """Mean structural similarity of images in [0, 1], differentiable by ``img1``.

    Args:
        img1: rendered images.
        img2: true images; constant, as in the original.
        padding: "same" for zeros beyond the image; "valid" for pixels whose window is inside.
        train: False for no gradient.

    Raises:
        UnservedArgument: another padding.
    """
    if padding not in ("same", "valid"):
        raise refuse("fused_ssim", f"padding={padding!r}", "Use padding='same' or 'valid'.")
    with torch.set_grad_enabled(train and torch.is_grad_enabled()):
        values = ssim_map(img1.permute(0, 2, 3, 1), img2.detach().permute(0, 2, 3, 1))
    if padding == "valid":
        values = values[:, RADIUS:-RADIUS, RADIUS:-RADIUS]
    return values.mean()
