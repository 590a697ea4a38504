"""Ground plan: cells of a scene from above, with its points and cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from gsfw.charts.style import INK, SERIES, new_figure, place, styled, write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIDE, MARGIN = 720.0, 44.0
"""Longer side of the plan and its margin, in layout units."""
MOST_DOTS = 20_000
"""Points that are drawn at most, evenly chosen."""


@dataclass(frozen=True)
class PlanCell:
    """A rectangle with a name; sides may be at infinity."""

    name: str
    low: tuple[float, float]
    high: tuple[float, float]
    margin: float = 0.0


@dataclass(frozen=True)
class GroundPlan:
    """A scene from above, in units of the data."""

    title: str
    cells: Sequence[PlanCell]
    points: Float64[np.ndarray, "p 2"]
    cameras: Float64[np.ndarray, "v 2"]


@styled
def ground_plan_figure(plan: GroundPlan) -> Figure:
    """Draw points, cameras, and each cell with its name and its margin as a dashed line."""
    from matplotlib.patches import Rectangle

    everything = np.concatenate([plan.points, plan.cameras])
    low, high = np.quantile(everything, [0.005, 0.995], axis=0)
    low, high = low - 0.05 * (high - low), high + 0.05 * (high - low)
    sides = np.maximum(high - low, 1e-12 * max(1.0, float(np.abs(everything).max())))
    width, height = SIDE * sides / sides.max()
    figure = new_figure(width + 2 * MARGIN, max(height, 120.0) + 2 * MARGIN)
    axes = place(figure, MARGIN, MARGIN, MARGIN + width, MARGIN + max(height, 120.0))
    axes.set_title(plan.title)
    step = -(-len(plan.points) // MOST_DOTS)
    axes.plot(*plan.points[::step].T, ",", color=INK, alpha=0.4)
    axes.plot(*plan.cameras.T, ".", color=SERIES[1], markersize=4)
    for number, cell in enumerate(plan.cells):
        color = SERIES[number % len(SERIES)]
        start, end = np.maximum(cell.low, low), np.minimum(cell.high, high)
        axes.add_patch(Rectangle(tuple(start), *(end - start), fill=False, ec=color, lw=1.5))
        outer = start - cell.margin, end + cell.margin
        axes.add_patch(
            Rectangle(
                tuple(outer[0]), *(outer[1] - outer[0]), fill=False, ec=color, lw=0.6, ls="--"
            )
        )
        x, y = (start + end) / 2
        axes.text(x, y, cell.name, color=color, ha="center", va="center")
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    return figure


def write_ground_plan(path: Path, plan: GroundPlan) -> None:
    """Write the picture as a PNG.

    Raises:
        OutputError: it cannot be written.
    """
    write_figure(path, ground_plan_figure(plan))
