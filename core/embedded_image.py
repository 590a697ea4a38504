"""Embedded image: an image as an HTML element that holds it, for notebooks."""

from __future__ import annotations

import base64
import io
from html import escape

from jaxtyping import Float
from PIL import Image
from torch import Tensor

from gsfw.core.color_bytes import color_bytes

LONGEST_SIDE = 360
"""Longest side of an image in a notebook, in pixels: larger ones are shrunk."""
QUALITY = 90
"""WebP quality. A photo of fox takes a seventh of its PNG, and notebooks keep every output."""


def image_element(image: Float[Tensor, "h w d"], title: str = "") -> str:
    """An image as an HTML element that holds it as WebP.

    Args:
        image: colours in [0, 1], others are clamped; with fewer than three channels the first one
            as grey, with more the first three.
        title: shown while the pointer is on it.
    """
    pixels = image.detach()[..., :3] if image.shape[2] >= 3 else image.detach()[..., :1]
    data = color_bytes(pixels.float().nan_to_num()).cpu()
    picture = Image.fromarray(data.expand(*data.shape[:2], 3).contiguous().numpy())
    picture.thumbnail((LONGEST_SIDE, LONGEST_SIDE))
    buffer = io.BytesIO()
    picture.save(buffer, "WEBP", quality=QUALITY)
    content = base64.b64encode(buffer.getvalue()).decode("ascii")
    text = escape(title)
    return (
        f'<img src="data:image/webp;base64,{content}" title="{text}" alt="{text}" '
        f'width="{picture.width}" height="{picture.height}" style="margin:2px">'
    )
