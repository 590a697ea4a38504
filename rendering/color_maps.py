"""Colour maps: values as colours, over a range that is robust, with a bar that tells which."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import torch

from gsfw.core.color_bytes import color_bytes

if TYPE_CHECKING:
    from jaxtyping import Float
    from PIL import ImageFont
    from PIL.Image import Image as Picture
    from torch import Tensor

UNKNOWN = 0.11
"""Grey of pixels without a value."""

INK = (214, 214, 220)
"""Colour of ticks and of type, in 8 bits."""

OUTLIERS = 0.01
"""Part of the values that may lie below the range, and above it."""

SAMPLED = 200_000
"""Values of which the range is found: a sample of so many differs by less than a colour."""


def value_range(
    values: Float[Tensor, "*any"], low: float | None = None, high: float | None = None
) -> tuple[float, float]:
    """The range of the finite values, without the least and the largest 1 %.

    Args:
        values: any; those that are not finite are left out.
        low: a least value that is given; ``None``: that of the values.
        high: a largest value that is given; ``None``: that of the values.

    Returns:
        ``low < high``; (0, 1) where there are no values and no ends are given.
    """
    known = values.detach().flatten()
    known = known[known.isfinite()].float()
    known = known[:: len(known) // SAMPLED + 1]
    if len(known):
        ends = torch.quantile(known, known.new_tensor([OUTLIERS, 1 - OUTLIERS])).tolist()
    else:
        ends = [0.0, 1.0]
    first = ends[0] if low is None else low
    last = ends[1] if high is None else high
    if last > first:
        return first, last
    # One value only: a range around it, or from a given end.
    margin = max(abs(first) * 0.05, 1e-3)
    return (first if low is not None else first - margin), first + margin


def colored(
    values: Float[Tensor, "h w"], low: float, high: float, colormap: str = "turbo"
) -> Float[Tensor, "h w 3"]:
    """Colours of values from ``low`` to ``high``, in [0, 1]; dark grey where a value is not finite.

    Args:
        values: any.
        low: value of the first colour; lower ones have it too.
        high: value of the last colour; higher ones have it too.
        colormap: its name in matplotlib.
    """
    table = _table(colormap).to(values.device)
    known = values.isfinite()
    place = (values - low) / max(high - low, 1e-30) * (len(table) - 1)
    index = place.nan_to_num(0.0).clamp(0, len(table) - 1).round().long()
    return torch.where(known[..., None], table[index], UNKNOWN)


def color_bar(
    height: int, low: float, high: float, unit: str = "", colormap: str = "turbo"
) -> Float[Tensor, "h w 3"]:
    """A bar of the colours, with the values beside it, light on dark; its width follows the text.

    Args:
        height: of the image, in pixels.
        low: value at the bottom.
        high: value at the top.
        unit: written at the side, upwards; empty for none.
        colormap: its name in matplotlib.
    """
    import numpy as np
    from PIL import Image, ImageDraw

    size = max(min(height // 18, 26), 9)
    font = type_face(size)
    margin = max(size * 2 // 3, 4)
    bar = max(size, 6)
    ticks = _ticks(low, high, max(min(height // (4 * size), 6), 2))
    width_of_text = max(int(font.getlength(text)) for _, text in ticks)
    room_for_unit = size + margin if unit and height > 6 * size else 0
    width = margin + bar + margin // 2 + 3 + width_of_text + margin + room_for_unit
    image = Image.new("RGB", (width, height), tuple([round(255 * UNKNOWN)] * 3))
    top, bottom = margin, max(height - margin, margin + 2)
    ramp = torch.linspace(high, low, bottom - top)[:, None].expand(-1, bar)
    pixels = color_bytes(colored(ramp, low, high, colormap)).numpy()
    image.paste(Image.fromarray(np.ascontiguousarray(pixels)), (margin, top))
    draw = ImageDraw.Draw(image)
    edge = margin + bar
    for value, text in ticks:
        y = bottom - 1 - (value - low) / (high - low) * (bottom - 1 - top)
        draw.line([(edge, y), (edge + 3, y)], fill=INK)
        at = min(max(y, top + size / 2), bottom - size / 2)
        draw.text((edge + margin // 2 + 3, at), text, fill=INK, font=font, anchor="lm")
    if room_for_unit:
        _write_upwards(image, unit, font, (width - size - margin // 2, height // 2))
    return torch.from_numpy(np.asarray(image).copy()).float() / 255


def _write_upwards(
    image: Picture, text: str, font: ImageFont.FreeTypeFont, middle: tuple[int, int]
) -> None:
    """Write a text from the bottom to the top; it is left out where there is no room for it."""
    from PIL import Image, ImageDraw

    length, size = int(font.getlength(text)) + 2, int(font.size * 1.4)
    if length > image.height:
        return
    strip = Image.new("RGB", (length, size), image.getpixel((0, 0)))
    ImageDraw.Draw(strip).text((0, size / 2), text, fill=INK, font=font, anchor="lm")
    turned = strip.rotate(90, expand=True)
    image.paste(turned, (middle[0] - turned.width // 2 + size // 3, middle[1] - length // 2))


def _ticks(low: float, high: float, most: int) -> Sequence[tuple[float, str]]:
    """Round values from ``low`` to ``high`` with their text; the two ends if none is round."""
    span = high - low
    rough = span / max(most, 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * factor for factor in (1, 2, 2.5, 5, 10) if power * factor >= rough * 0.999)
    first, last = math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6)
    values = [number * step for number in range(first, last + 1)]
    if len(values) < 2:
        values = [low, high]
    digits = max(0, -math.floor(math.log10(step)) + (abs(step / power - 2.5) < 1e-9))
    large = max(abs(low), abs(high)) >= 1e5 or digits > 4
    return [(value, f"{value:.3g}" if large else f"{value + 0.0:.{digits}f}") for value in values]


@lru_cache(maxsize=16)
def type_face(size: int) -> ImageFont.FreeTypeFont:
    """The house's type: that of the charts, which is there on every machine."""
    import matplotlib
    from PIL import ImageFont

    return ImageFont.truetype(f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSans.ttf", size)


@lru_cache(maxsize=16)
def _table(colormap: str) -> Float[Tensor, "256 3"]:
    """256 colours, in [0, 1]."""
    import numpy as np
    from matplotlib import colormaps

    return torch.from_numpy(np.asarray(colormaps[colormap](np.linspace(0, 1, 256)))[:, :3]).float()
