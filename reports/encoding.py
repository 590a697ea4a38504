"""Encoding: images as WebP of a bounded size."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from gsfw.core.color_bytes import color_bytes
from gsfw.core.loop.area import area_means

QUALITIES = (82, 70, 55, 40, 25, 10)
"""WebP qualities, tried in order until the file is small enough."""


def fitted(image: Float[Tensor, "h w 3"], longest: int) -> UInt8[np.ndarray, "h2 w2 3"]:
    """An image as 8-bit sRGB, shrunk by area means until no side is longer than ``longest``."""
    height, width = image.shape[:2]
    share = min(longest / max(height, width), 1.0)
    small = (max(round(width * share), 1), max(round(height * share), 1))
    shrunk = image.detach().float().clamp(0, 1)
    if small != (width, height):
        shrunk = area_means(shrunk[None], *small)[0]
    pixels: np.ndarray = color_bytes(shrunk).cpu().numpy()
    return pixels


def webp(image: UInt8[np.ndarray, "h w 3"], at_most: int) -> bytes:
    """A still image in at most ``at_most`` bytes, smaller where no quality is low enough."""
    return animated_webp([image], 0, at_most)


def animated_webp(
    frames: Sequence[UInt8[np.ndarray, "h w 3"]], milliseconds: int, at_most: int
) -> bytes:
    """Frames of one size as an endless film, of the best quality, then the largest size, that fits.

    Args:
        frames: at least one.
        milliseconds: how long each is shown.
        at_most: bytes of the file.
    """
    pictures = [Image.fromarray(np.ascontiguousarray(frame)) for frame in frames]
    while True:
        for quality in QUALITIES:
            content = _encoded(pictures, milliseconds, quality)
            if len(content) <= at_most:
                return content
        width, height = pictures[0].size
        if width == height == 1:
            return content
        small = (max(width // 2, 1), max(height // 2, 1))
        pictures = [picture.resize(small, Image.Resampling.BOX) for picture in pictures]


def _encoded(pictures: Sequence[Image.Image], milliseconds: int, quality: int) -> bytes:
    buffer = io.BytesIO()
    if len(pictures) == 1:
        pictures[0].save(buffer, "WEBP", quality=quality, method=4)
        return buffer.getvalue()
    pictures[0].save(
        buffer,
        "WEBP",
        save_all=True,
        append_images=pictures[1:],
        duration=milliseconds,
        loop=0,
        quality=quality,
        method=2,
    )
    return buffer.getvalue()
