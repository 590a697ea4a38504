"""DotPlot: the accuracy of every row on every scene as dots, with the spread over seeds."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from gsfw.charts.time_plot import GRID, INK, OVERSAMPLING, PAPER, Axis
from gsfw.core.files.atomic import write_atomically
from gsfw.studies.comparison import Column, Figure, SceneTable, heading

WIDTH = 960
MARGINS = (24, 34, 24, 44)
"""Left, top, right and bottom of a panel, in pixels; names of rows come to the left of it."""
LINE = 22
"""Height of a row, in pixels."""
GAP = 30
"""Height of a scene's name."""
RADIUS = 5.0
MOST_PANELS = 3
COLORS = (
    (31, 91, 171),
    (209, 98, 36),
    (46, 134, 84),
    (146, 72, 158),
    (178, 44, 60),
    (20, 138, 150),
    (150, 118, 30),
    (96, 96, 104),
)
"""Of rows, in order; they come round again."""


def write_dot_plot(path: Path, tables: Sequence[SceneTable]) -> bool:
    """Draw a panel for each of the first measures of accuracy; whether there is any to draw.

    Raises:
        OutputError: the file cannot be written.
    """
    columns = list(dict.fromkeys(c for table in tables for c in table.columns if c.best))
    columns = columns[:MOST_PANELS]
    if not columns:
        return False
    buffer = io.BytesIO()
    _plot(tables, columns).save(buffer, "PNG", optimize=True)
    write_atomically(path, buffer.getvalue())
    return True


def _plot(tables: Sequence[SceneTable], columns: Sequence[Column]) -> Image.Image:
    """Panels side by side, which share the names of scenes and rows."""
    scale, (left, top, right, bottom) = OVERSAMPLING, MARGINS
    rows = list(dict.fromkeys(line.row for table in tables for line in table.lines))
    lines = sum(1 for table in tables for line in table.lines if line.figures)
    height = top + len(tables) * GAP + lines * LINE + bottom
    image = Image.new("RGB", (WIDTH * scale, height * scale), PAPER)
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(14 * scale)
    labels = [*rows, *(table.scene for table in tables)]
    names = max(draw.textlength(label, font) for label in labels) + (left + 14) * scale
    each = (WIDTH * scale - names) / len(columns)
    for number, column in enumerate(columns):
        first = names + number * each
        place = (first, first + each - right * scale, float(height * scale))
        _panel(draw, tables, column, rows, place)
    y = float(top * scale)
    for table in tables:
        draw.text((left * scale, y + GAP * scale / 2), table.scene, INK, font, "lm", stroke_width=1)
        y += GAP * scale
        for line in table.lines:
            if line.figures:
                draw.text((names - 12 * scale, y + LINE * scale / 2), line.row, INK, font, "rm")
                y += LINE * scale
    return image.resize((WIDTH, height), Image.Resampling.BOX)


def _panel(
    draw: ImageDraw.ImageDraw,
    tables: Sequence[SceneTable],
    column: Column,
    rows: Sequence[str],
    place: tuple[float, float, float],
) -> None:
    """One measure; ``place`` is the panel's left and right and the picture's height."""
    scale, (_, top, _, bottom) = OVERSAMPLING, MARGINS
    first, last, height = place
    font = ImageFont.load_default(13 * scale)
    figures = [
        line.figures[column.name]
        for table in tables
        for line in table.lines
        if column.name in line.figures
    ]
    ends = [figure.mean + sign * (figure.spread or 0) for figure in figures for sign in (-1, 1)]
    across = Axis.over(ends, first + RADIUS * scale, last - RADIUS * scale)
    draw.text(((first + last) / 2, top * scale / 2), heading(column), INK, font, "mm")
    floor = height - bottom * scale
    for mark in across.marks[:: 2 if len(across.marks) > 6 else 1]:
        x = across.at(mark)
        draw.line([(x, top * scale), (x, floor)], fill=GRID, width=scale)
        draw.text((x, floor + 8 * scale), f"{mark:g}", INK, font, anchor="mt")
    draw.line([(first, floor), (last, floor)], fill=INK, width=scale)
    y = float(top * scale)
    for table in tables:
        y += GAP * scale
        for line in table.lines:
            if line.figures:
                if column.name in line.figures:
                    color = COLORS[rows.index(line.row) % len(COLORS)]
                    middle = y + LINE * scale / 2
                    _dot(draw, across, line.figures[column.name], middle, color)
                y += LINE * scale


def _dot(
    draw: ImageDraw.ImageDraw,
    across: Axis,
    figure: Figure,
    y: float,
    color: tuple[int, int, int],
) -> None:
    """A figure, its spread, and a thin line that leads the eye to it."""
    x, radius = across.at(figure.mean), RADIUS * OVERSAMPLING
    draw.line([(across.first, y), (x, y)], fill=GRID, width=OVERSAMPLING)
    if figure.spread:
        low, high = (across.at(figure.mean + sign * figure.spread) for sign in (-1, 1))
        draw.line([(low, y), (high, y)], fill=color, width=2 * OVERSAMPLING)
        for end in (low, high):
            draw.line([(end, y - radius), (end, y + radius)], fill=color, width=2 * OVERSAMPLING)
    draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=color)
