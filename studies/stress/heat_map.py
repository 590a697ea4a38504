"""HeatMap: the error of every backend and dtype over planes, with its cliffs, as a picture."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from gsfw.charts.time_plot import INK, OVERSAMPLING, PAPER
from gsfw.core.files.atomic import write_atomically
from gsfw.studies.stress.plane import EMPTY, PlaneErrors

Color = tuple[int, int, int]

CELL = 13
"""Side of one measurement, in pixels."""
MARGINS = (66, 66, 20, 96)
"""Left, top, right and bottom of the whole picture, in pixels."""
GAPS = (74, 96)
"""Between panels side by side, and one below the other."""
RAMP: tuple[tuple[float, Color], ...] = (
    (-17.0, (24, 28, 84)),
    (-12.0, (44, 92, 170)),
    (-7.0, (76, 176, 190)),
    (-5.0, (158, 214, 120)),
    (-3.0, (250, 224, 90)),
    (-1.0, (234, 120, 40)),
    (0.0, (176, 20, 30)),
)
"""Colours of powers of ten; in between they are mixed."""
NOTHING: Color = (232, 232, 236)
NOT_FINITE: Color = (0, 0, 0)
MARKS = (-16, -14, -12, -10, -8, -6, -4, -2, 0)
FIELDS = ("picture", "gradient")


def color_of(error: float) -> Color:
    """The colour of a relative error; EMPTY and NaN have their own."""
    if error == EMPTY:
        return NOTHING
    if not math.isfinite(error):
        return NOT_FINITE
    power = min(max(math.log10(error) if error > 0 else RAMP[0][0], RAMP[0][0]), RAMP[-1][0])
    for (low, first), (high, last) in pairwise(RAMP):
        if power <= high:
            share = (power - low) / (high - low)
            mixed = [round(a + share * (b - a)) for a, b in zip(first, last, strict=True)]
            return mixed[0], mixed[1], mixed[2]
    return RAMP[-1][1]


def write_heat_map(path: Path, measured: Sequence[PlaneErrors]) -> None:
    """Draw a row of panels for each backend and dtype: each plane, by picture and by gradient.

    Raises:
        OutputError: the file cannot be written.
    """
    buffer = io.BytesIO()
    _drawn(measured).save(buffer, "PNG", optimize=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, buffer.getvalue())


def _drawn(measured: Sequence[PlaneErrors]) -> Image.Image:
    scale, (left, top, right, bottom) = OVERSAMPLING, MARGINS
    rows = list(dict.fromkeys((errors.backend, errors.dtype) for errors in measured))
    planes = list(dict.fromkeys(errors.plane.name for errors in measured))
    wide = max(len(errors.plane.across_values) for errors in measured) * CELL
    high = max(len(errors.plane.upward_values) for errors in measured) * CELL
    panels = len(planes) * len(FIELDS)
    width = left + panels * wide + (panels - 1) * GAPS[0] + right
    height = top + len(rows) * high + (len(rows) - 1) * GAPS[1] + bottom
    image = Image.new("RGB", (width * scale, height * scale), PAPER)
    draw = ImageDraw.Draw(image)
    for errors in measured:
        row = rows.index((errors.backend, errors.dtype))
        for number, kind in enumerate(FIELDS):
            column = planes.index(errors.plane.name) * len(FIELDS) + number
            place = (left + column * (wide + GAPS[0]), top + row * (high + GAPS[1]))
            _panel(draw, errors, kind, place)
    _legend(draw, (left, height - 44), width - left - right)
    return image.resize((width, height), Image.Resampling.BOX)


def _panel(
    draw: ImageDraw.ImageDraw, errors: PlaneErrors, kind: str, place: tuple[int, int]
) -> None:
    """One plane by one measure; ``place`` is its upper left corner."""
    scale, (left, top) = OVERSAMPLING, place
    plane, table = errors.plane, errors.picture if kind == "picture" else errors.gradient
    bottom, right = top + len(table) * CELL, left + len(table[0]) * CELL
    for y, row in enumerate(table):
        for x, error in enumerate(row):
            corner = (left + x * CELL, bottom - (y + 1) * CELL)
            ends = [scale * corner[0], scale * corner[1]]
            ends += [scale * (corner[0] + CELL) - 1, scale * (corner[1] + CELL) - 1]
            draw.rectangle(ends, fill=color_of(error))
    frame = [scale * left, scale * top, scale * right, scale * bottom]
    draw.rectangle(frame, outline=INK, width=scale)
    small, font = ImageFont.load_default(11 * scale), ImageFont.load_default(13 * scale)
    title = f"{errors.backend}, {errors.dtype}: {kind}"
    draw.text((scale * left, scale * (top - 24)), title, INK, font, "ls", stroke_width=0.3 * scale)
    draw.text((scale * left, scale * (top - 7)), f"up: {plane.upward}", INK, small, "ls")
    draw.text((scale * (left + right) / 2, scale * (bottom + 24)), plane.across, INK, small, "mt")
    for x in _marks(plane.across_values, 5):
        middle, text = scale * (left + (x + 0.5) * CELL), _label(plane.across_values[x])
        draw.text((middle, scale * (bottom + 6)), text, INK, small, "mt")
    for y in _marks(plane.upward_values, 6):
        middle, text = scale * (bottom - (y + 0.5) * CELL), _label(plane.upward_values[y])
        draw.text((scale * (left - 6), middle), text, INK, small, "rm")


def _marks(values: Sequence[float], most: int) -> list[int]:
    """Which values have their number beside them: powers of ten, where there are enough of them."""
    powers = [index for index, value in enumerate(values) if _is_power(value)]
    places = powers if len(powers) >= most else list(range(len(values)))
    return places[:: math.ceil(len(places) / most)]


def _is_power(value: float) -> bool:
    return abs(math.log10(value) - round(math.log10(value))) < 1e-9


def _label(value: float) -> str:
    small = 0.01 <= value <= 100
    return f"1e{round(math.log10(value))}" if _is_power(value) and not small else f"{value:g}"


def _legend(draw: ImageDraw.ImageDraw, place: tuple[int, int], width: int) -> None:
    """The colours of powers of ten, and of what has none."""
    scale, (left, top) = OVERSAMPLING, place
    font = ImageFont.load_default(12 * scale)
    bar = min(420, width // 2)
    draw.text((scale * left, scale * (top + 6)), "relative error (L2)", INK, font, "lm")
    start, low, high = left + 130.0, RAMP[0][0], RAMP[-1][0]
    for x in range(bar * scale):
        error = 10.0 ** (low + (high - low) * x / (bar * scale - 1))
        line = [(scale * start + x, scale * top), (scale * start + x, scale * (top + 12))]
        draw.line(line, fill=color_of(error))
    for mark in MARKS:
        middle = scale * (start + bar * (mark - low) / (high - low))
        draw.text((middle, scale * (top + 16)), f"1e{mark}", INK, font, "mt")
    side = start + bar + 40.0
    for color, text in ((NOTHING, "nothing to be drawn"), (NOT_FINITE, "not finite, or refused")):
        corner = [scale * side, scale * top, scale * (side + 12), scale * (top + 12)]
        draw.rectangle(corner, fill=color, outline=INK)
        draw.text((scale * (side + 18), scale * (top + 6)), text, INK, font, "lm")
        side += 170.0
