"""Color bytes: colours of [0, 1] as the 256 levels of images and of files of splats."""

from __future__ import annotations

import torch
from jaxtyping import Float, UInt8
from torch import Tensor


def color_bytes(colors: Float[Tensor, "*b"]) -> UInt8[Tensor, "*b"]:
    """The nearest level of each value; those outside [0, 1] count as its ends."""
    return (colors.clamp(0, 1) * 255).round().to(torch.uint8)
