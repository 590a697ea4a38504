"""TimePlot: how good the pictures are at each time, drawn as a plot."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from gsfw.core.files.atomic import write_atomically
from gsfw.core.loop.evaluation import Evaluation

SIZE = (960, 480)
"""Of the plot, in pixels."""
MARGINS = (76, 44, 24, 60)
"""Left, top, right and bottom of the axes, in pixels."""
OVERSAMPLING = 2
"""Drawn this much larger and then shrunk: Pillow's lines have hard edges."""
SERIES = (
    ("psnr", "PSNR of all pixels", (31, 91, 171)),
    ("moving_psnr", "PSNR of what moves", (209, 98, 36)),
)
"""Figure, what the legend calls it, colour."""
INK, GRID, PAPER = (60, 60, 64), (224, 224, 228), (255, 255, 255)
TICKS = 6
"""About so many marks on an axis."""

Point = tuple[float, float]


@dataclass(frozen=True)
class Axis:
    """A range of numbers and where it lies in the picture."""

    marks: tuple[float, ...]
    low: float
    high: float
    first: float
    """Pixel of ``low``."""
    last: float
    """Pixel of ``high``."""
    by_ratio: bool = False
    """Whether equal ratios have equal lengths, instead of equal differences."""

    @staticmethod
    def of_ratios(values: Sequence[float], first: float, last: float) -> Axis:
        """A logarithmic axis around values above 0, with marks at 1, 2 and 5 of every decade."""
        decades = range(math.floor(math.log10(min(values))), math.ceil(math.log10(max(values))) + 1)
        marks = [float(f"{digit}e{decade}") for decade in decades for digit in (1, 2, 5)]
        low = max(mark for mark in marks if mark <= min(values))
        high = min(mark for mark in marks if mark >= max(values))
        inside = tuple(mark for mark in marks if low <= mark <= high)
        return Axis(inside, low, high, first, last, by_ratio=True)

    @staticmethod
    def over(values: Sequence[float], first: float, last: float, tight: bool = False) -> Axis:
        """An axis with round marks around values; ``tight`` ends at the values."""
        low, high = min(values), max(values)
        if high - low < 1e-9:
            low, high = low - 0.5, high + 0.5
        step = _round_step((high - low) / TICKS)
        start, stop = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
        if not tight:
            low, high = start * step, stop * step
        marks = (number * step for number in range(start, stop + 1))
        inside = tuple(mark for mark in marks if low - 1e-9 <= mark <= high + 1e-9)
        return Axis(inside, low, high, first, last)

    def at(self, value: float) -> float:
        """Pixel of a value."""
        low, high = self.low, self.high
        if self.by_ratio:
            low, high, value = math.log(low), math.log(high), math.log(value)
        return self.first + (value - low) / (high - low) * (self.last - self.first)


def _round_step(step: float) -> float:
    """The nearest larger 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(factor * power for factor in (1, 2, 5, 10) if factor * power >= step * (1 - 1e-9))


def write_time_plot(document: Path, evaluation: Evaluation) -> Path | None:
    """Plot PSNR over time as a PNG; ``None`` where there are no two times to plot.

    Args:
        document: the result file that the plot lies beside, as NAME_over_time.png.
        evaluation: whose figures are plotted.

    Raises:
        OutputError: the file cannot be written.
    """
    points = evaluation.over_time
    lines = [
        (name, color, [(float(p["data_time"]), float(p[key])) for p in points if key in p])
        for key, name, color in SERIES
    ]
    drawn = [(name, color, line) for name, color, line in lines if len(line) > 1]
    if not drawn:
        return None
    path = document.with_name(f"{document.stem}_over_time.png")
    buffer = io.BytesIO()
    _plot(drawn).save(buffer, "PNG", optimize=True)
    write_atomically(path, buffer.getvalue())
    return path


def _plot(lines: Sequence[tuple[str, tuple[int, int, int], list[Point]]]) -> Image.Image:
    scale = OVERSAMPLING
    width, height = (float(scale * side) for side in SIZE)
    left, top, right, bottom = (float(scale * margin) for margin in MARGINS)
    image = Image.new("RGB", (int(width), int(height)), PAPER)
    draw = ImageDraw.Draw(image)
    every = [point for _, _, line in lines for point in line]
    across = Axis.over([x for x, _ in every], left, width - right, tight=True)
    upward = Axis.over([y for _, y in every], height - bottom, top)
    _axes(draw, across, upward)
    font, x = ImageFont.load_default(15 * scale), left
    for name, color, line in lines:
        pixels = [(across.at(a), upward.at(b)) for a, b in line]
        draw.line(pixels, fill=color, width=2 * scale, joint="curve")
        for a, b in pixels:
            radius = 2.5 * scale
            draw.ellipse((a - radius, b - radius, a + radius, b + radius), fill=color)
        draw.line([(x, top / 2), (x + 26 * scale, top / 2)], fill=color, width=3 * scale)
        mean = sum(y for _, y in line) / len(line)
        label = f"{name}, mean over times {mean:.2f} dB"
        draw.text((x + 34 * scale, top / 2), label, INK, font, anchor="lm")
        x += draw.textlength(label, font) + 70 * scale
    return image.resize(SIZE, Image.Resampling.BOX)


def draw_grid(draw: ImageDraw.ImageDraw, across: Axis, upward: Axis) -> None:
    """Grid, marks and both axes of a plot that is drawn ``OVERSAMPLING`` times too large."""
    scale = OVERSAMPLING
    font = ImageFont.load_default(13 * scale)
    for mark in upward.marks:
        y = upward.at(mark)
        draw.line([(across.first, y), (across.last, y)], fill=GRID, width=scale)
        draw.text((across.first - 8 * scale, y), f"{mark:g}", INK, font, anchor="rm")
    for mark in across.marks:
        x = across.at(mark)
        draw.line([(x, upward.first), (x, upward.last)], fill=GRID, width=scale)
        draw.text((x, upward.first + 8 * scale), f"{mark:g}", INK, font, anchor="mt")
    corner = [(across.first, upward.last), (across.first, upward.first)]
    draw.line([*corner, (across.last, upward.first)], fill=INK, width=scale)


def _axes(draw: ImageDraw.ImageDraw, across: Axis, upward: Axis) -> None:
    """The grid, and what it means."""
    draw_grid(draw, across, upward)
    scale = OVERSAMPLING
    font = ImageFont.load_default(13 * scale)
    middle = (across.first + across.last) / 2
    draw.text((middle, upward.first + 32 * scale), "time, as the data has it", INK, font, "mt")
    draw.text((10 * scale, (upward.first + upward.last) / 2), "dB", INK, font, anchor="lm")
