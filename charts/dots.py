"""Dot plot: metrics of named rows in groups, a panel for each metric, with spreads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsfw.charts.style import (
    GRID,
    SERIES,
    mark_axis,
    new_figure,
    place,
    round_marks,
    styled,
    text_width,
    write,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH = 960.0
"""Width of the figure, in layout units; so are all sizes here."""
LEFT, TOP, RIGHT, BOTTOM = 24.0, 36.0, 26.0, 40.0
NAME_GAP = 14.0
"""Between the names of rows and the first panel."""
ROW, GROUP = 22.0, 30.0
"""Heights of a row and of the name of a group."""
MOST_MARKS = 6


@dataclass(frozen=True)
class Dot:
    """A metric of a row."""

    mean: float
    spread: float | None = None
    """Half the length of the error bar; ``None`` or 0 for none."""


@dataclass(frozen=True)
class Group:
    """Rows under one heading, for example those of a scene."""

    name: str
    rows: Mapping[str, Mapping[str, Dot]]
    """Dots by row and by panel; a row without a dot in a panel is empty there."""


@styled
def dot_figure(groups: Sequence[Group], panels: Mapping[str, str]) -> Figure:
    """Panels side by side that share the names of groups and rows; a row name has one colour.

    Args:
        groups: from top to bottom, with at least one dot for each panel among them.
        panels: titles by the names that ``Group.rows`` has.
    """
    names = list(dict.fromkeys(row for group in groups for row in group.rows))
    height = TOP + BOTTOM + sum(GROUP + ROW * len(group.rows) for group in groups)
    widths = [text_width(name) for name in names]
    widths += [text_width(group.name, bold=True) for group in groups]
    first = LEFT + max(widths) + NAME_GAP
    figure = new_figure(max(WIDTH, first + WIDTH / 2), height)
    each = (figure.get_figwidth() * 100 - first) / len(panels)
    for number, (key, title) in enumerate(panels.items()):
        left = first + number * each
        axes = place(figure, left, TOP, left + each - RIGHT, height - BOTTOM)
        axes.set_ylim(height - BOTTOM, TOP)
        axes.set_title(title, weight="normal", pad=9.0)
        _panel(axes, [(names.index(row), y, dots.get(key)) for row, y, dots in _rows(groups)])
    y = TOP
    for group in groups:
        write(figure, LEFT, y + GROUP / 2, group.name, bold=True)
        y += GROUP + ROW * len(group.rows)
    for row, y, _ in _rows(groups):
        write(figure, first - NAME_GAP, y, row, align="right")
    return figure


def _rows(groups: Sequence[Group]) -> Iterator[tuple[str, float, Mapping[str, Dot]]]:
    """Name, middle and dots of each row."""
    y = TOP
    for group in groups:
        y += GROUP
        for name, dots in group.rows.items():
            yield name, y + ROW / 2, dots
            y += ROW


def _panel(axes: Axes, rows: Sequence[tuple[int, float, Dot | None]]) -> None:
    """Dots with error bars, and a thin line that leads the eye from the name to the dot."""
    found = [(color, y, dot) for color, y, dot in rows if dot is not None]
    ends = [dot.mean + side * (dot.spread or 0.0) for _, _, dot in found for side in (-1, 1)]
    marks = round_marks(min(ends), max(ends))
    mark_axis(axes, "x", marks)
    shown = marks[:: 2 if len(marks) > MOST_MARKS else 1]
    axes.set_xticks(shown, [f"{mark:g}" for mark in shown])
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    margin = 0.02 * (marks[-1] - marks[0])
    axes.set_xlim(marks[0] - margin, marks[-1] + margin)
    for number, y, dot in found:
        color = SERIES[number % len(SERIES)]
        axes.plot([marks[0] - margin, dot.mean], [y, y], color=GRID, linewidth=0.8, zorder=1)
        axes.errorbar(
            *([dot.mean], [y]),
            xerr=[dot.spread] if dot.spread else None,
            fmt="o",
            color=color,
            markersize=7.0,
            elinewidth=1.6,
            capsize=3.5,
            capthick=1.6,
            zorder=3,
        )
