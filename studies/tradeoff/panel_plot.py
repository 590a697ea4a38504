"""PanelPlot: quality against several costs side by side, with what nothing beats named."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from gsfw.charts.time_plot import INK, OVERSAMPLING, PAPER, Axis, draw_grid
from gsfw.core.files.atomic import write_atomically
from gsfw.studies.tradeoff.front import Point

SIZE = (640, 620)
"""Of a panel, in pixels."""
MARGINS = (64, 66, 26, 74)
"""Left, top, right and bottom of a panel, in pixels."""
RADIUS = 4.5
MOST_COST, MOST_LOSS = 2.5, 10.0
"""What costs this many times what the first does, or is so many dB worse, would press all others
into a corner: it is counted below the plot."""
WIDE = 10.0
"""Costs that differ by more than this factor are drawn by their ratio."""
HEAD = 32
"""Rows of pixels that the legend takes; names of dots stay below."""
HALO = 2 * OVERSAMPLING
"""Paper around names, in pixels of the large picture: they may lie over lines."""
Box = tuple[float, float, float, float]
Color = tuple[int, int, int]


@dataclass(frozen=True)
class Dot:
    """A variant in a panel."""

    name: str
    """By which the front has it."""
    label: str
    """Beside it, if nothing beats it."""
    color: Color
    cost: float
    psnr: float
    spread: float = 0.0
    """Of the cost."""


@dataclass(frozen=True)
class Panel:
    """A plane of cost and quality."""

    unit: str
    """Below it."""
    dots: Sequence[Dot]
    """At least one; what all others are compared with comes first, and lies above them."""
    unbeaten: Sequence[Point]


def write_panel_plot(path: Path, panels: Sequence[Panel], legend: Mapping[str, Color]) -> None:
    """Draw the panels, and the front in each.

    Raises:
        OutputError: the file cannot be written.
    """
    scale = OVERSAMPLING
    width = SIZE[0] * len(panels)
    image = Image.new("RGB", (width * scale, SIZE[1] * scale), PAPER)
    draw = ImageDraw.Draw(image)
    for number, panel in enumerate(panels):
        _panel(draw, float(number * SIZE[0] * scale), panel)
    _legend(draw, legend)
    buffer = io.BytesIO()
    image.resize((width, SIZE[1]), Image.Resampling.BOX).save(buffer, "PNG", optimize=True)
    write_atomically(path, buffer.getvalue())


def _panel(draw: ImageDraw.ImageDraw, offset: float, panel: Panel) -> None:
    """One plane; ``offset`` is the pixel at which it begins."""
    scale, (left, top, right, bottom) = OVERSAMPLING, MARGINS
    near = [dot for dot in panel.dots if _is_near(dot, panel.dots[0])]
    end = offset + SIZE[0] * scale - right * scale
    across = _cost_axis([dot.cost for dot in near], offset + left * scale, end)
    upward = Axis.over(
        [dot.psnr for dot in near], float((SIZE[1] - bottom) * scale), float(top * scale)
    )
    far = len(panel.dots) - len(near)
    _axes(draw, across, upward, panel.unit, f"{far} not shown: far off" if far else "")
    labels = {dot.name: dot.label for dot in near}
    inside = [point for point in panel.unbeaten if point.name in labels]
    line = [(across.at(point.cost), upward.at(point.quality)) for point in inside]
    if len(line) > 1:
        draw.line(line, fill=(170, 170, 176), width=2 * scale, joint="curve")
    places = [_draw_dot(draw, dot, across, upward) for dot in reversed(near)]
    for point, place in zip(inside, line, strict=True):
        _label(draw, labels[point.name], place, (across.first, end), places)


def _cost_axis(costs: Sequence[float], first: float, last: float) -> Axis:
    """From nothing; by ratio where the small ones would lie in a corner."""
    if min(costs) > 0 and max(costs) > WIDE * min(costs):
        return Axis.of_ratios(costs, first, last)
    return Axis.over([0.0, *costs], first, last)


def _is_near(dot: Dot, first: Dot) -> bool:
    return dot.cost <= MOST_COST * first.cost and dot.psnr >= first.psnr - MOST_LOSS


def _draw_dot(draw: ImageDraw.ImageDraw, dot: Dot, across: Axis, upward: Axis) -> Box:
    """A dot with the spread of its cost; the place that it takes."""
    scale, size = OVERSAMPLING, RADIUS * OVERSAMPLING
    x, y = across.at(dot.cost), upward.at(dot.psnr)
    if dot.spread:
        wings = (dot.cost - dot.spread / 2, dot.cost + dot.spread / 2)
        ends = [across.at(min(max(wing, across.low), across.high)) for wing in wings]
        draw.line([(ends[0], y), (ends[1], y)], fill=dot.color, width=scale)
    box = (x - size, y - size, x + size, y + size)
    draw.ellipse(box, fill=dot.color)
    return box


def _label(
    draw: ImageDraw.ImageDraw,
    text: str,
    point: tuple[float, float],
    limits: tuple[float, float],
    places: list[Box],
) -> None:
    """Write a label beside its point where nothing else is; ``places`` are taken, and it joins."""
    scale = OVERSAMPLING
    font = ImageFont.load_default(12 * scale)
    width, height = draw.textlength(text, font), 14.0 * scale
    gap, (x, y) = 9.0 * scale, point
    tried = [
        (x + side - (width if side < 0 else 0), y + rise * height - height / 2)
        for rise in (0, -1, 1, -2, 2, -3, 3, 4, 5)
        for side in (gap, -gap)
    ]
    for a, b in tried:
        box = (a, b, a + width, b + height)
        inside = limits[0] <= a and a + width <= limits[1] and b >= HEAD * scale
        if inside and not any(_overlap(box, other) for other in places):
            draw.text(
                (a, b + height / 2), text, INK, font, "lm", stroke_width=HALO, stroke_fill=PAPER
            )
            places.append(box)
            return
    draw.text((x + gap, y), text, INK, font, "lm", stroke_width=HALO, stroke_fill=PAPER)


def _overlap(first: Box, second: Box) -> bool:
    apart = first[2] < second[0] or second[2] < first[0]
    return not (apart or first[3] < second[1] or second[3] < first[1])


def _axes(draw: ImageDraw.ImageDraw, across: Axis, upward: Axis, unit: str, note: str) -> None:
    """The grid, and what it means."""
    draw_grid(draw, across, upward)
    scale = OVERSAMPLING
    font = ImageFont.load_default(13 * scale)
    middle = (across.first + across.last) / 2
    draw.text((middle, upward.first + 28 * scale), unit, INK, font, "mt")
    draw.text((across.last, upward.first + 28 * scale), note, INK, font, "rt")
    draw.text((across.first, upward.last - 14 * scale), "PSNR, dB", INK, font, "lm")


def _legend(draw: ImageDraw.ImageDraw, legend: Mapping[str, Color]) -> None:
    """A dot for each colour."""
    scale = OVERSAMPLING
    font, x, y = ImageFont.load_default(14 * scale), float(MARGINS[0] * scale), 22.0 * scale
    size = RADIUS * scale
    for name, color in legend.items():
        draw.ellipse((x - size, y - size, x + size, y + size), fill=color)
        draw.text((x + 12 * scale, y), name, INK, font, "lm")
        x += draw.textlength(name, font) + 38 * scale
