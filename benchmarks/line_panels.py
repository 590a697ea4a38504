"""LinePanels: a picture of several plots side by side, each with lines over one quantity."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from gsfw.charts.time_plot import GRID, INK, OVERSAMPLING, PAPER, Axis
from gsfw.core.files.atomic import write_atomically
from gsfw.studies.dot_plot import COLORS

SIZE = (400, 330)
"""Of a panel, in pixels."""
MARGINS = (64, 34, 16, 52)
"""Left, top, right and bottom of the axes in a panel."""
LEGEND = 26
"""Height of a line of the legend, which is below the panels."""


@dataclass(frozen=True)
class Line:
    """One series, of the same name and colour in every panel."""

    name: str
    points: tuple[tuple[float, float], ...]
    dashed: bool = False


@dataclass(frozen=True)
class Panel:
    """One plot."""

    title: str
    across: str
    """What the horizontal axis has."""
    lines: tuple[Line, ...]
    doubling: bool = True
    """Whether the horizontal axis has equal steps for equal ratios, and marks at its points."""
    decades: bool = False
    """Whether the vertical axis has: marks are powers of ten."""


def write_panels(path: Path, panels: Sequence[Panel]) -> None:
    """Draw panels side by side as a PNG, with one legend.

    Raises:
        OutputError: the file cannot be written.
    """
    scale = OVERSAMPLING
    names = list(dict.fromkeys(line.name for panel in panels for line in panel.lines))
    size = (SIZE[0] * len(panels), SIZE[1] + LEGEND * -(-len(names) // 2) + LEGEND // 2)
    image = Image.new("RGB", (size[0] * scale, size[1] * scale), PAPER)
    draw = ImageDraw.Draw(image)
    for number, panel in enumerate(panels):
        _panel(draw, panel, names, float(number * SIZE[0] * scale))
    font = ImageFont.load_default(14 * scale)
    for number, name in enumerate(names):
        x = (MARGINS[0] + (number % 2) * size[0] / 2) * scale
        y = (SIZE[1] + (number // 2 + 0.5) * LEGEND) * scale
        draw.line([(x, y), (x + 28 * scale, y)], fill=_color(names, name), width=3 * scale)
        draw.text((x + 38 * scale, y), name, INK, font, anchor="lm")
    buffer = io.BytesIO()
    image.resize(size, Image.Resampling.BOX).save(buffer, "PNG", optimize=True)
    write_atomically(path, buffer.getvalue())


def _panel(draw: ImageDraw.ImageDraw, panel: Panel, names: Sequence[str], shift: float) -> None:
    scale = OVERSAMPLING
    left, top, right, bottom = (float(scale * margin) for margin in MARGINS)
    width, height = (float(scale * side) for side in SIZE)
    points = [point for line in panel.lines for point in line.points]
    across = Axis.over(
        [_place(x, panel.doubling) for x, _ in points],
        shift + left,
        shift + width - right,
        tight=True,
    )
    upward = Axis.over([_height(y, panel.decades) for _, y in points], height - bottom, top)
    font = ImageFont.load_default(13 * scale)
    for mark in upward.marks:
        if panel.decades and mark != round(mark):
            continue
        y = upward.at(mark)
        draw.line([(across.first, y), (across.last, y)], fill=GRID, width=scale)
        label = f"{10**mark:g}" if panel.decades else f"{mark:g}"
        draw.text((across.first - 7 * scale, y), label, INK, font, anchor="rm")
    marks = sorted({x for x, _ in points}) if panel.doubling else across.marks
    for mark in marks[:: 2 if len(marks) > 7 else 1]:
        x = across.at(_place(mark, panel.doubling))
        draw.line([(x, upward.last), (x, upward.first)], fill=GRID, width=scale)
        draw.text((x, upward.first + 7 * scale), f"{mark:g}", INK, font, anchor="mt")
    corner = [(across.first, upward.last), (across.first, upward.first)]
    draw.line([*corner, (across.last, upward.first)], fill=INK, width=scale)
    middle = (across.first + across.last) / 2
    draw.text((middle, upward.first + 28 * scale), panel.across, INK, font, anchor="mt")
    draw.text((middle, top / 2), panel.title, INK, font, anchor="mm", stroke_width=1)
    for line in panel.lines:
        pixels = [
            (across.at(_place(x, panel.doubling)), upward.at(_height(y, panel.decades)))
            for x, y in line.points
        ]
        _line(draw, pixels, _color(names, line.name), line.dashed)


def _line(
    draw: ImageDraw.ImageDraw,
    pixels: Sequence[tuple[float, float]],
    color: tuple[int, int, int],
    dashed: bool,
) -> None:
    scale = OVERSAMPLING
    if not dashed:
        draw.line(list(pixels), fill=color, width=2 * scale, joint="curve")
        for x, y in pixels:
            radius = 2.5 * scale
            draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=color)
        return
    (first, y), (last, _) = pixels[0], pixels[-1]
    dash = 7.0 * scale
    for number in range(int((last - first) / dash / 2) + 1):
        x = first + 2 * number * dash
        draw.line([(x, y), (min(x + dash, last), y)], fill=color, width=2 * scale)


def _color(names: Sequence[str], name: str) -> tuple[int, int, int]:
    return COLORS[list(names).index(name) % len(COLORS)]


def _place(value: float, doubling: bool) -> float:
    return math.log2(value) if doubling else float(value)


def _height(value: float, decades: bool) -> float:
    return math.log10(value) if decades else float(value)
