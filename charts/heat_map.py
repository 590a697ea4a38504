"""Heat maps of relative errors over two quantities, on one logarithmic colour scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsfw.charts.style import (
    INK,
    PAPER,
    SMALL,
    UNITS,
    Color,
    new_figure,
    place,
    styled,
    write,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

CELL = 13.0
"""Side of a cell, in layout units; so are all sizes here."""
LEFT, TOP, RIGHT, BOTTOM = 70.0, 62.0, 24.0, 104.0
ACROSS, DOWN = 78.0, 98.0
"""Gaps between panels."""
SCALE: tuple[tuple[float, Color], ...] = (
    (-17.0, "#181c54"),
    (-12.0, "#2c5caa"),
    (-7.0, "#4cb0be"),
    (-5.0, "#9ed678"),
    (-3.0, "#fae05a"),
    (-1.0, "#ea7828"),
    (0.0, "#b0141e"),
)
"""Colours of powers of ten, interpolated between them."""
NOTHING: Color = "#e8e8ec"
NOT_FINITE: Color = "#000000"
MARKS = (-16, -14, -12, -10, -8, -6, -4, -2, 0)
BELOW = -99.0
"""Stands for an empty cell: below the colour scale, so that it gets the colour of these."""


@dataclass(frozen=True)
class HeatPanel:
    """Errors over a plane."""

    title: str
    across: str
    upward: str
    across_values: Sequence[float]
    """Values of the columns, above 0; columns are equidistant."""
    upward_values: Sequence[float]
    """Values of the rows, from the bottom up, above 0."""
    errors: Sequence[Sequence[float | None]]
    """Rows as ``upward_values``; ``None`` where there is nothing to compare."""


@styled
def heat_figure(rows: Sequence[Sequence[HeatPanel]]) -> Figure:
    """Rows of panels over a common colour bar."""
    panels = [panel for row in rows for panel in row]
    wide = CELL * max(len(panel.across_values) for panel in panels)
    high = CELL * max(len(panel.upward_values) for panel in panels)
    columns = max(map(len, rows))
    width = max(LEFT + columns * (wide + ACROSS) - ACROSS + RIGHT, 840.0)
    figure = new_figure(width, TOP + len(rows) * (high + DOWN) - DOWN + BOTTOM)
    for number, row in enumerate(rows):
        for column, panel in enumerate(row):
            left, top = LEFT + column * (wide + ACROSS), TOP + number * (high + DOWN)
            right = left + CELL * len(panel.across_values)
            axes = place(figure, left, top, right, top + CELL * len(panel.upward_values))
            write(figure, left, top - 28, panel.title, bold=True)
            write(figure, left, top - 11, f"up: {panel.upward}", size=SMALL)
            image = _panel(axes, panel)
    _legend(figure, image)
    return figure


def color_map() -> Colormap:
    """Colours over log10 of an error; empty and not finite cells have their own."""
    from matplotlib.colors import LinearSegmentedColormap

    low, high = SCALE[0][0], SCALE[-1][0]
    stops = [((power - low) / (high - low), color) for power, color in SCALE]
    colors = LinearSegmentedColormap.from_list("errors", stops, N=1024)
    return colors.with_extremes(bad=NOT_FINITE, under=NOTHING)


def _panel(axes: Axes, panel: HeatPanel) -> AxesImage:
    image = axes.imshow(
        np.ma.masked_invalid([[_power(error) for error in row] for row in panel.errors]),
        cmap=color_map(),
        vmin=SCALE[0][0],
        vmax=SCALE[-1][0],
        origin="lower",
        aspect="auto",
        interpolation="nearest",
    )
    axes.grid(visible=False)
    axes.spines[:].set_visible(True)
    axes.set_xlabel(panel.across, size=SMALL, labelpad=6.0)
    columns, lines = _marks(panel.across_values, 5), _marks(panel.upward_values, 6)
    axes.set_xticks(columns, [_text(panel.across_values[x]) for x in columns])
    axes.set_yticks(lines, [_text(panel.upward_values[y]) for y in lines])
    return image


def _power(error: float | None) -> float:
    """log10 of an error, within the colour scale; NaN where the error is not finite."""
    if error is None:
        return BELOW
    if not math.isfinite(error):
        return math.nan
    low, high = SCALE[0][0], SCALE[-1][0]
    return min(max(math.log10(error), low), high) if error > 0 else low


def _marks(values: Sequence[float], most: int) -> list[int]:
    """Indices of the values that are labelled: powers of ten, if there are enough of them."""
    powers = [index for index, value in enumerate(values) if _is_power(value)]
    places = powers if len(powers) >= most else list(range(len(values)))
    return places[:: math.ceil(len(places) / most)]


def _is_power(value: float) -> bool:
    return abs(math.log10(value) - round(math.log10(value))) < 1e-9


def _text(value: float) -> str:
    small = 0.01 <= value <= 100
    return f"1e{round(math.log10(value))}" if _is_power(value) and not small else f"{value:g}"


def _legend(figure: Figure, image: AxesImage) -> None:
    """The colour bar, and patches for the two kinds of cells without an error."""
    from matplotlib.patches import Patch

    width, height = figure.get_size_inches() * UNITS
    top = height - 44.0
    write(figure, LEFT, top + 6, "relative error (L2)")
    bar = place(figure, LEFT + 132, top, LEFT + 132 + 330, top + 12)
    scale = figure.colorbar(image, cax=bar, orientation="horizontal")
    scale.set_ticks(list(MARKS), labels=[f"1e{mark}" for mark in MARKS])
    figure.legend(
        handles=[
            Patch(facecolor=NOTHING, edgecolor=INK, linewidth=0.6, label="nothing to render"),
            Patch(facecolor=NOT_FINITE, edgecolor=PAPER, label="not finite, or refused"),
        ],
        loc="center left",
        bbox_to_anchor=((LEFT + 132 + 350) / width, 1 - (top + 6) / height),
        ncols=2,
        handlelength=1.0,
        handleheight=1.0,
        borderpad=0.0,
        columnspacing=1.4,
    )
