"""ParetoPlot: PSNR against size and against time, with the variants that nothing beats named."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from gsfw.core.run_folder import write_atomically
from gsfw.core.time_plot import INK, OVERSAMPLING, PAPER, Axis, draw_grid
from gsfw.studies.dot_plot import COLORS
from gsfw.studies.tradeoff.front import Point, size_front, time_front
from gsfw.studies.tradeoff.record import Record
from gsfw.studies.tradeoff.variant import AS_IS, AXES, STORAGE

SIZE = (1280, 620)
"""Of the plot, in pixels."""
MARGINS = (64, 66, 26, 74)
"""Left, top, right and bottom of a panel, in pixels."""
RADIUS = 4.5
MOST_COST, MOST_LOSS = 2.5, 10.0
"""Variants that cost this many times what the model as it is does, or lose this many dB, would
press all others into a corner: they are counted below the plot."""
HALO = 2 * OVERSAMPLING
"""Paper around names, in pixels of the large picture: they may lie over lines."""
BLACK = (20, 20, 22)
COLOR = {AS_IS: BLACK} | {
    axis: COLORS[index] if index < len(COLORS) else (222, 72, 140)
    for index, axis in enumerate(AXES)
}
Box = tuple[float, float, float, float]


def write_pareto_plot(path: Path, records: Sequence[Record]) -> None:
    """Draw both planes, and the fronts in them.

    Raises:
        OutputError: the file cannot be written.
    """
    buffer = io.BytesIO()
    _plot(records).save(buffer, "PNG", optimize=True)
    write_atomically(path, buffer.getvalue())


def _plot(records: Sequence[Record]) -> Image.Image:
    scale = OVERSAMPLING
    image = Image.new("RGB", (SIZE[0] * scale, SIZE[1] * scale), PAPER)
    draw = ImageDraw.Draw(image)
    drawn = [record for record in records if record.psnr is not None]
    timed = [record for record in drawn if record.ms is not None]
    half = SIZE[0] * scale / 2
    _panel(draw, 0.0, [r for r in drawn if r.axis in STORAGE], size_front(drawn), "MB")
    if timed:
        _panel(draw, half, timed, time_front(timed), "ms for a view")
    _legend(draw, drawn)
    return image.resize(SIZE, Image.Resampling.BOX)


def _cost(record: Record, unit: str) -> float:
    return record.size / 1e6 if unit == "MB" else record.ms or 0.0


def _panel(
    draw: ImageDraw.ImageDraw,
    offset: float,
    records: Sequence[Record],
    unbeaten: Sequence[Point],
    unit: str,
) -> None:
    """One plane; ``offset`` is the pixel at which it begins."""
    scale, (left, top, right, bottom) = OVERSAMPLING, MARGINS
    first = next((r for r in records if r.axis == AS_IS), records[0])
    near = [r for r in records if _is_near(r, first, unit)]
    end = offset + SIZE[0] * scale / 2 - right * scale
    across = Axis.over([0.0, *(_cost(r, unit) for r in near)], offset + left * scale, end)
    upward = Axis.over(
        [r.psnr or 0.0 for r in near], float((SIZE[1] - bottom) * scale), float(top * scale)
    )
    far = len(records) - len(near)
    _axes(draw, across, upward, unit, f"{far} not shown: far off" if far else "")
    inside = [p for p in unbeaten if any(_name(r) == p.name for r in near)]
    line = [(across.at(p.cost), upward.at(p.quality)) for p in inside]
    if len(line) > 1:
        draw.line(line, fill=(170, 170, 176), width=2 * scale, joint="curve")
    places: list[Box] = []
    for record in reversed(near):  # The model as it is comes last, and lies above all others.
        x, y = across.at(_cost(record, unit)), upward.at(record.psnr or 0.0)
        if unit != "MB" and record.ms_spread:
            reach = (across.last - across.first) / (across.high - across.low)
            wing = record.ms_spread / 2 * reach
            ends = (max(x - wing, across.first), min(x + wing, across.last))
            draw.line([(ends[0], y), (ends[1], y)], fill=COLOR[record.axis], width=scale)
        size = RADIUS * scale
        draw.ellipse((x - size, y - size, x + size, y + size), fill=COLOR[record.axis])
        places.append((x - size, y - size, x + size, y + size))
    for point, (x, y) in zip(inside, line, strict=True):
        _label(draw, point.name, (x, y), (offset, end), places)


def _is_near(record: Record, first: Record, unit: str) -> bool:
    cheap = _cost(record, unit) <= MOST_COST * _cost(first, unit)
    return cheap and (record.psnr or 0.0) >= (first.psnr or 0.0) - MOST_LOSS


def _name(record: Record) -> str:
    return f"{record.axis}: {record.name}"


def _label(
    draw: ImageDraw.ImageDraw,
    name: str,
    point: tuple[float, float],
    limits: tuple[float, float],
    places: list[Box],
) -> None:
    """Write a name beside its point where nothing else is; ``places`` are taken, and it joins."""
    scale = OVERSAMPLING
    font = ImageFont.load_default(12 * scale)
    axis, _, rest = name.partition(": ")
    text = rest if axis in (AS_IS, "combined", "cutoffs", "prune") else f"{axis} {rest}"
    width, height = draw.textlength(text, font), 14.0 * scale
    gap, (x, y) = 9.0 * scale, point
    tried = [
        (x + side - (width if side < 0 else 0), y + rise * height - height / 2)
        for rise in (0, -1, 1, -2, 2, -3, 3)
        for side in (gap, -gap)
    ]
    for a, b in tried:
        box = (a, b, a + width, b + height)
        inside = limits[0] <= a and a + width <= limits[1]
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


def _legend(draw: ImageDraw.ImageDraw, records: Sequence[Record]) -> None:
    """A dot for each axis that is there."""
    scale = OVERSAMPLING
    font, x, y = ImageFont.load_default(14 * scale), float(MARGINS[0] * scale), 22.0 * scale
    present = [axis for axis in (AS_IS, *AXES) if any(r.axis == axis for r in records)]
    for axis in present:
        size = RADIUS * scale
        draw.ellipse((x - size, y - size, x + size, y + size), fill=COLOR[axis])
        draw.text((x + 12 * scale, y), axis, INK, font, "lm")
        x += draw.textlength(axis, font) + 38 * scale
