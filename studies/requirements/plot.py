"""Plot: the requirements of a run at a glance, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jaxtyping import UInt8
from torch import Tensor

from gsfw.charts.time_plot import GRID, INK, PAPER, Axis
from gsfw.core.loop.requirements import Requirements
from gsfw.studies.dot_plot import COLORS
from gsfw.studies.requirements.canvas import Canvas, Color
from gsfw.studies.requirements.census import BAND, TIME
from gsfw.studies.requirements.sentences import decibels, percent

WIDTH = 1120
MARGIN = 32.0
FLOATS, WORTH = (250.0, 520.0), (730.0, 1010.0)
"""Where bars begin and end, across; what is written beside them comes after."""
HEADING, BAR, LINE, CURVE = 48.0, 26.0, 24.0, 170.0
"""Heights of the heading, the bar of all floats, a row, and the curve of growth."""
LEAST_DB = 0.2
"""An axis of decibels shows at least so many: less would make much of nothing."""
FAINT, FAINTER = (120, 120, 126), (176, 176, 182)
BLUES = ((12, 52, 110), (31, 91, 171), (84, 142, 212), (142, 184, 234), (194, 218, 246))
"""Of SH bands, from the constant one on."""


@dataclass(frozen=True)
class _Row:
    """A line of the plot."""

    name: str
    color: Color
    floats: int
    """0 where they are counted in another row."""
    note: str
    """Beside the bar of floats."""
    db: float | None


def plot(requirements: Requirements) -> UInt8[Tensor, "h w 3"]:
    """Floats by group, in one bar and in rows; beside them dB; below, rows by SH degree."""
    rows = [*_groups(requirements), *_others(requirements)]
    curve = growth(requirements)
    body = HEADING + BAR + (len(rows) + 2) * LINE
    foot = max((len(requirements.rows_by_degree) + 1) * LINE, CURVE if curve else 0.0)
    canvas = Canvas(WIDTH, round(body + foot + LINE / 2))
    _heading(canvas, requirements)
    _bar_of_all(canvas, rows)
    _rows(canvas, rows, HEADING + BAR + LINE)
    if requirements.rows_by_degree:
        _degrees(canvas, requirements, body)
    if curve:
        _curve(canvas, curve, body)
    return canvas.pixels()


def growth(requirements: Requirements) -> list[tuple[float, float]]:
    """Steps and numbers of Gaussians, where the strategy reports a curve of them."""
    points = requirements.strategy.get("curve", [])
    return [
        (float(point["step"]), float(point["num_gaussians"]))
        for point in points
        if "step" in point and "num_gaussians" in point
    ]


def _groups(requirements: Requirements) -> list[_Row]:
    """The groups of floats, the constant band before the others."""
    total, rows = max(requirements.total_floats, 1), []
    others = iter(COLORS[1:] * 9)
    for group in requirements.groups:
        is_band = group.name.startswith(BAND)
        color = BLUES[int(group.name[len(BAND) :])] if is_band else next(others)
        note = f"{_short(group.floats)} floats, {percent(group.floats / total)}"
        rows.append(_Row(group.name, color, group.floats, note, group.bought_db))
    return rows


def _others(requirements: Requirements) -> list[_Row]:
    """What was left out and is no group of floats."""
    rows = []
    motion = requirements.motion
    if motion is not None and all(group.name != TIME for group in requirements.groups):
        note = f"drawn as at time {motion.time:g} throughout"
        rows.append(_Row("change with time", FAINTER, 0, note, motion.bought_db))
    for item in requirements.least_useful:
        note = f"hold {percent(item.contribution)} of the contribution"
        name = f"the least useful {percent(item.part)}"
        rows.append(_Row(name, FAINTER, 0, note, item.bought_db))
    return rows


def _heading(canvas: Canvas, requirements: Requirements) -> None:
    kind = "held-out" if requirements.split == "eval" else "training"
    canvas.text(
        MARGIN,
        HEADING / 2,
        f"{_short(requirements.total_floats)} floats in {requirements.num_gaussians:,} Gaussians; "
        f"PSNR {requirements.psnr:.2f} dB on {len(requirements.views)} {kind} views",
        size=16,
    )


def _bar_of_all(canvas: Canvas, rows: Sequence[_Row]) -> None:
    """All floats as one bar, from margin to margin."""
    each = (WIDTH - 2 * MARGIN) / max(sum(row.floats for row in rows), 1)
    x = MARGIN
    for row in rows:
        canvas.box(x, HEADING, x + row.floats * each, HEADING + BAR, row.color)
        x += row.floats * each


def _rows(canvas: Canvas, rows: Sequence[_Row], top: float) -> None:
    """Names, floats and decibels, row by row."""
    across, most = _decibel_axis(rows), max(1, *(row.floats for row in rows))
    canvas.text(FLOATS[0], top, "where the floats went", color=FAINT)
    canvas.text(WORTH[0], top, "what leaving it out costs in PSNR", color=FAINT)
    for number, row in enumerate(rows, start=1):
        y = top + number * LINE
        canvas.text(MARGIN, y, row.name)
        reach = (FLOATS[1] - FLOATS[0]) * row.floats / most
        if row.floats:
            canvas.box(FLOATS[0], y - 8, FLOATS[0] + reach, y + 8, row.color)
        beside = FLOATS[0] + (reach + 8 if row.floats else 0)
        canvas.text(beside, y, row.note, color=INK if row.floats else FAINT)
        _decibels(canvas, row, across, y)
    zero = across.at(0.0)
    canvas.line([(zero, top + LINE / 2), (zero, top + (len(rows) + 0.5) * LINE)], INK)


def _decibel_axis(rows: Sequence[_Row]) -> Axis:
    """Wide enough for groups of floats; what costs far more would press them together."""
    groups = [row.db for row in rows if row.floats and row.db is not None]
    low, high = min([0.0, *groups]), max([LEAST_DB, *groups])
    return Axis.over([low, high], *WORTH, tight=True)


def _decibels(canvas: Canvas, row: _Row, across: Axis, y: float) -> None:
    """The bar of a row and its number; a gap in a bar says that it would go on."""
    zero = across.at(0.0)
    if row.db is None:
        canvas.text(zero + 6, y, "not measured", color=FAINTER)
        return
    first, last = WORTH
    end = min(max(across.at(row.db), first), last)
    canvas.box(zero, y - 8, end, y + 8, row.color)
    if row.db > across.high:
        canvas.box(last - 12, y - 8, last - 7, y + 8, PAPER)
    canvas.text(max(end, zero) + 8, y, decibels(row.db))


def _degrees(canvas: Canvas, requirements: Requirements, top: float) -> None:
    """How many Gaussians have each SH degree."""
    counts = requirements.rows_by_degree
    canvas.text(MARGIN, top + 14, "Gaussians by SH degree", color=FAINT)
    for degree, count in enumerate(counts):
        y = top + 14 + (degree + 1) * LINE
        part = count / max(sum(counts), 1)
        canvas.text(MARGIN, y, f"degree {degree}")
        reach = part * (FLOATS[1] - FLOATS[0] - 110)
        canvas.box(MARGIN + 76, y - 8, MARGIN + 76 + reach, y + 8, BLUES[degree])
        canvas.text(MARGIN + 84 + reach, y, f"{count:,}, {percent(part)}")


def _curve(canvas: Canvas, points: Sequence[tuple[float, float]], top: float) -> None:
    """How the number of Gaussians grew."""
    left, right, bottom = WORTH[0] - 110, WIDTH - MARGIN, top + CURVE - 26
    across = Axis.over([x for x, _ in points], left, right, tight=True)
    upward = Axis.over([0.0, *(y for _, y in points)], bottom, top + 30)
    canvas.text(left, top + 14, "Gaussians by step", color=FAINT)
    for mark in upward.marks[:: max(1, len(upward.marks) // 3)]:
        y = upward.at(mark)
        canvas.line([(left, y), (right, y)], GRID)
        canvas.text(left - 8, y, _short(mark), "rm")
    for mark in across.marks:
        canvas.text(across.at(mark), bottom + 8, f"{mark:g}", "mt")
    canvas.line([(across.at(x), upward.at(y)) for x, y in points], COLORS[0], 2.0)


def _short(number: int | float) -> str:
    """A count as people read it: 950, 12.3 k, 4.56 M."""
    for size, unit in ((1e6, " M"), (1e3, " k")):
        if number >= size:
            return f"{number / size:.3g}{unit}"
    return f"{number:g}"
