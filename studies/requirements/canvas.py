"""Canvas: a picture that is drawn larger than it is, in its own pixels."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from gsfw.charts.time_plot import INK, OVERSAMPLING, PAPER

Color = tuple[int, int, int]


class Canvas:
    """Takes places in pixels of the picture as it will be."""

    def __init__(self, width: int, height: int) -> None:
        self._size = (width, height)
        large = (width * OVERSAMPLING, height * OVERSAMPLING)
        self._image = Image.new("RGB", large, PAPER)
        self._draw = ImageDraw.Draw(self._image)

    def text(
        self, x: float, y: float, text: str, anchor: str = "lm", size: int = 13, color: Color = INK
    ) -> None:
        """Write a line; ``anchor`` says which part of it is at x, y, as Pillow has it."""
        font = ImageFont.load_default(size * OVERSAMPLING)
        self._draw.text((x * OVERSAMPLING, y * OVERSAMPLING), text, color, font, anchor)

    def text_width(self, text: str, size: int = 13) -> float:
        """How wide a line is."""
        font = ImageFont.load_default(size * OVERSAMPLING)
        return self._draw.textlength(text, font) / OVERSAMPLING

    def box(self, left: float, top: float, right: float, bottom: float, color: Color) -> None:
        """Fill a rectangle, at least half a pixel wide."""
        ends = (min(left, right), max(left, right, min(left, right) + 0.5))
        # Pillow counts the last row and column in.
        self._draw.rectangle(
            (
                ends[0] * OVERSAMPLING,
                top * OVERSAMPLING,
                ends[1] * OVERSAMPLING - 1,
                bottom * OVERSAMPLING - 1,
            ),
            fill=color,
        )

    def line(self, points: Sequence[tuple[float, float]], color: Color, width: float = 1.0) -> None:
        """Draw lines from point to point."""
        large = [(x * OVERSAMPLING, y * OVERSAMPLING) for x, y in points]
        self._draw.line(large, fill=color, width=round(width * OVERSAMPLING), joint="curve")

    def pixels(self) -> UInt8[Tensor, "h w 3"]:
        """The picture."""
        small = self._image.resize(self._size, Image.Resampling.BOX)
        return torch.from_numpy(np.array(small))
