"""Lines over one quantity: panels side by side with one legend."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsfw.charts.style import (
    SERIES,
    Color,
    mark_axis,
    new_figure,
    place,
    ratio_marks,
    round_marks,
    styled,
    text_width,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANEL = (400.0, 330.0)
"""Default size of a panel, in layout units."""
LEFT, TOP, RIGHT, BOTTOM = 66.0, 12.0, 20.0, 54.0
"""Margins of a panel, in layout units."""
TITLE, LEGEND_ROW = 24.0, 24.0
LEGEND_HANDLE = 70.0
"""Line, dot and space of an entry of the legend, in layout units."""
MOST_MARKED = 60
"""Lines of more points have no dot at each point."""
MOST_TICKS = 7
"""Logarithmic axes with more points label every other point."""
TICK_ROOM = 110.0
"""Pixels from tick to tick along a wide axis."""


@dataclass(frozen=True)
class Line:
    """A series; a series of one name has one colour in all panels."""

    name: str
    points: tuple[tuple[float, float], ...]
    dashed: bool = False
    """Dashed lines have no dots: they show a level."""
    color: Color = ""
    """Empty: the next of the house colours."""


@dataclass(frozen=True)
class LinePanel:
    """One plot."""

    title: str
    across: str
    """Label of the horizontal axis."""
    lines: tuple[Line, ...]
    upward: str = ""
    """Label of the vertical axis."""
    doubling: bool = False
    """The horizontal axis is logarithmic, with ticks at the points."""
    ratio: bool = False
    """The horizontal axis is logarithmic, with round ticks."""
    decades: bool = False
    """The vertical axis is logarithmic, with ticks at powers of ten if it spans several."""


@styled
def line_figure(
    panels: Sequence[LinePanel], size: tuple[float, float] = PANEL, columns: int = 2
) -> Figure:
    """Panels side by side, under one legend.

    Args:
        panels: at least one, each with at least one line of at least one point.
        size: of a panel without the legend, in layout units.
        columns: of the legend; fewer if the names are too long for the figure.
    """
    names = list(dict.fromkeys(line.name for panel in panels for line in panel.lines))
    entry = LEGEND_HANDLE + max(map(text_width, names))
    columns = max(1, min(columns, int((size[0] * len(panels) - LEFT) / entry)))
    legend = LEGEND_ROW * -(-len(names) // columns)
    title = TITLE if any(panel.title for panel in panels) else 0.0
    figure = new_figure(size[0] * len(panels), size[1] + legend + title)
    artists: dict[str, Artist] = {}
    for number, panel in enumerate(panels):
        left, top = number * size[0], legend + title
        axes = place(figure, left + LEFT, top + TOP, left + size[0] - RIGHT, top + size[1] - BOTTOM)
        _axes(axes, panel)
        for line in panel.lines:
            color = line.color or SERIES[names.index(line.name) % len(SERIES)]
            style = "--" if line.dashed else "-"
            marker = "" if line.dashed or len(line.points) > MOST_MARKED else "o"
            (artists[line.name],) = axes.plot(
                *zip(*line.points, strict=True),
                style,
                marker=marker,
                color=color,
                clip_on=False,
                zorder=3,
            )
    figure.legend(
        [artists[name] for name in names],
        names,
        loc="upper left",
        bbox_to_anchor=(LEFT / (size[0] * len(panels)), 1.0),
        ncols=columns,
        borderaxespad=0.5,
        borderpad=0.0,
        columnspacing=2.5,
    )
    return figure


def _axes(axes: Axes, panel: LinePanel) -> None:
    """Scales, ticks and labels; the horizontal axis ends at the first and the last point."""
    points = [point for line in panel.lines for point in line.points]
    xs, ys = ([point[side] for point in points] for side in (0, 1))
    if panel.doubling:
        places = sorted(set(xs))
        mark_axis(axes, "x", places, ratio=True)
        shown = places[:: 2 if len(places) > MOST_TICKS else 1]
        axes.set_xticks(shown, [f"{mark:g}" for mark in shown])
    elif panel.ratio:
        mark_axis(axes, "x", ratio_marks(min(xs), max(xs)), ratio=True)
    else:
        marks = round_marks(min(xs), max(xs), count=max(6, round(axes.bbox.width / TICK_ROOM)))
        low, high = (min(xs), max(xs)) if min(xs) < max(xs) else (marks[0], marks[-1])
        mark_axis(axes, "x", [mark for mark in marks if low <= mark <= high] or marks)
        axes.set_xlim(low, high)
    if panel.decades:
        every = ratio_marks(min(ys), max(ys))
        mark_axis(axes, "y", every, ratio=True)
        powers = [mark for mark in every if f"{mark:e}".startswith("1.0")]
        shown = powers if len(powers) > 1 else every
        axes.set_yticks(shown, [f"{mark:g}" for mark in shown])
    else:
        mark_axis(axes, "y", round_marks(min(ys), max(ys)))
    axes.set_title(panel.title, pad=10.0)
    axes.set_xlabel(panel.across, labelpad=8.0)
    axes.set_ylabel(panel.upward, labelpad=8.0)
