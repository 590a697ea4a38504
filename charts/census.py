"""Census: shares of a total by group, the worth of each group, and how the total came about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsfw.charts.style import (
    BLUES,
    FAINT,
    FAINTER,
    INK,
    LARGE,
    PAPER,
    SERIES,
    SMALL,
    Color,
    mark_axis,
    new_figure,
    place,
    round_marks,
    styled,
    write,
)
from gsfw.core.words import brief

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, MARGIN = 1120.0, 32.0
"""Width and margin of the figure, in layout units; so are all sizes here."""
COUNTS, WORTHS = (270.0, 540.0), (750.0, 1010.0)
"""Left and right ends of the bars; their numbers are to the right of them."""
HEADING, BAR, LINE, CURVE = 52.0, 26.0, 26.0, 190.0
"""Heights of the heading, of the stacked bar, of a row and of the curve."""
THICK = 0.62
"""Thickness of bars, in rows."""
LEAST_WORTH = 0.2
"""The axis of worth shows at least this much: smaller effects are not to look large."""


@dataclass(frozen=True)
class CensusRow:
    """A group of the total, or something else that was left out to learn its worth."""

    name: str
    color: Color
    count: int
    """0 if other rows count it."""
    note: str
    """Beside the bar of the count."""
    worth: float | None
    """``None`` where it was not measured."""
    worth_note: str = ""
    """Beside the bar of the worth."""


@dataclass(frozen=True)
class Census:
    """The whole chart."""

    title: str
    counts: str
    """Heading of the column of counts."""
    worths: str
    """Heading of the column of worths."""
    rows: Sequence[CensusRow]
    """At least one."""
    shares_title: str = ""
    shares: Sequence[tuple[str, int, str]] = ()
    """Name, count and note of each bar below the rows; none for no such bars."""
    curve_title: str = ""
    curve: Sequence[tuple[float, float]] = ()
    """Points of a curve below the rows; none for no curve."""


@styled
def census_figure(census: Census) -> Figure:
    """A stacked bar of all counts, rows with count and worth, and below them shares and a curve."""
    rows = census.rows
    body = HEADING + BAR + (len(rows) + 2) * LINE
    shares = (len(census.shares) + 1.5) * LINE if census.shares else 0.0
    foot = max(shares, CURVE if census.curve else 0.0)
    figure = new_figure(WIDTH, body + foot + LINE / 2)
    write(figure, MARGIN, HEADING / 2, census.title, size=LARGE)
    _stack(_bare(figure, MARGIN, HEADING, WIDTH - MARGIN, HEADING + BAR), rows)
    top = HEADING + BAR + 1.5 * LINE
    write(figure, COUNTS[0], top - LINE / 2, census.counts, color=FAINT)
    write(figure, WORTHS[0], top - LINE / 2, census.worths, color=FAINT)
    for number, row in enumerate(rows):
        write(figure, MARGIN, top + (number + 0.5) * LINE, row.name)
    bottom = top + len(rows) * LINE
    _counts(_bare(figure, COUNTS[0], top, COUNTS[1], bottom, len(rows)), rows)
    _worths(_bare(figure, WORTHS[0], top, WORTHS[1], bottom, len(rows)), rows)
    if census.shares:
        _shares(figure, census, body)
    if census.curve:
        _curve(figure, census, body)
    return figure


def _bare(
    figure: Figure, left: float, top: float, right: float, bottom: float, rows: int = 1
) -> Axes:
    """Axes without ticks and spines, whose rows count from the top: row i is around y = i."""
    axes = place(figure, left, top, right, bottom)
    axes.set_axis_off()
    axes.set_ylim(rows - 0.5, -0.5)
    return axes


def _stack(axes: Axes, rows: Sequence[CensusRow]) -> None:
    """All counts as one bar."""
    x = 0
    for row in rows:
        axes.barh(0, row.count, 1.0, left=x, color=row.color)
        x += row.count
    axes.set_xlim(0, max(x, 1))


def _counts(axes: Axes, rows: Sequence[CensusRow]) -> None:
    axes.set_xlim(0, max(1, *(row.count for row in rows)))
    for y, row in enumerate(rows):
        axes.barh(y, row.count, THICK, color=row.color)
        _note(axes, row.count, y, row.note, INK if row.count else FAINT, gap=bool(row.count))


def _worths(axes: Axes, rows: Sequence[CensusRow]) -> None:
    """Bars of worth; the scale is that of the groups, and a gap marks a bar that is cut off."""
    groups = [row.worth for row in rows if row.count and row.worth is not None]
    low, high = min([0.0, *groups]), max([LEAST_WORTH, *groups])
    axes.set_xlim(low, high)
    unit = (high - low) / (WORTHS[1] - WORTHS[0])
    for y, row in enumerate(rows):
        if row.worth is None:
            _note(axes, 0.0, y, "not measured", FAINTER)
            continue
        end = min(max(row.worth, low), high)
        axes.barh(y, end, THICK, color=row.color)
        if row.worth > high:
            axes.barh(y, 5 * unit, THICK, left=high - 12 * unit, color=PAPER)
        _note(axes, max(end, 0.0), y, row.worth_note)
    axes.plot([0.0, 0.0], [-0.5, len(rows) - 0.5], color=INK, linewidth=0.8, clip_on=False)


def _note(
    axes: Axes, x: int | float, y: int, text: str, color: Color = INK, gap: bool = True
) -> None:
    """Text to the right of a bar's end."""
    axes.annotate(
        text, (x, y), (6.0 if gap else 0.0, 0.0), textcoords="offset points", va="center",
        color=color, annotation_clip=False,
    )  # fmt: skip


def _shares(figure: Figure, census: Census, top: float) -> None:
    """Bars below the rows, on a scale of their own."""
    write(figure, MARGIN, top + LINE / 2, census.shares_title, color=FAINT)
    first = top + 1.2 * LINE
    bottom = first + len(census.shares) * LINE
    left = MARGIN + 84
    axes = _bare(figure, left, first, COUNTS[1] - 130, bottom, len(census.shares))
    axes.set_xlim(0.0, max(sum(count for _, count, _ in census.shares), 1))
    for y, (name, count, note) in enumerate(census.shares):
        write(figure, MARGIN, first + (y + 0.5) * LINE, name)
        axes.barh(y, count, THICK, color=BLUES[min(y, len(BLUES) - 1)])
        _note(axes, count, y, note)


def _curve(figure: Figure, census: Census, top: float) -> None:
    """A line below the rows."""
    left, right = WORTHS[0] - 110, WIDTH - MARGIN
    write(figure, left, top + LINE / 2, census.curve_title, color=FAINT)
    axes = place(figure, left, top + 1.4 * LINE, right, top + CURVE - 22)
    xs, ys = zip(*census.curve, strict=True)
    upward = round_marks(0.0, max(*ys, 1.0), count=3)
    mark_axis(axes, "y", upward)
    axes.set_yticks(upward, [brief(mark) for mark in upward], size=SMALL)
    marks = round_marks(min(xs), max(xs))
    mark_axis(axes, "x", [mark for mark in marks if min(xs) <= mark <= max(xs)] or marks)
    if min(xs) < max(xs):
        axes.set_xlim(min(xs), max(xs))
    axes.grid(visible=False, axis="x")
    axes.plot(xs, ys, color=SERIES[0], clip_on=False, zorder=3)
