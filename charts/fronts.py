"""Pareto fronts: quality over cost, a panel for each cost, with labels on the front."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gsfw.charts.style import (
    FAINT,
    FAINTER,
    PAPER,
    SMALL,
    Color,
    mark_axis,
    new_figure,
    place,
    ratio_marks,
    round_marks,
    styled,
    write,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation
    from matplotlib.transforms import Bbox

QUALITY = "PSNR (dB)"
"""Label of the vertical axis."""
PANEL = (640.0, 620.0)
"""Size of a panel, in layout units; so are all sizes here."""
LEFT, TOP, RIGHT, BOTTOM = 64.0, 74.0, 26.0, 64.0
MOST_COST, MOST_LOSS = 2.5, 10.0
"""Dots that cost this many times as much as the first dot, or whose quality is lower by so much,
would press all others into a corner: the panel counts them instead."""
WIDE = 10.0
"""Costs that differ by more than this factor get a logarithmic axis."""
NEAR, FAR = 8.0, 60.0
"""Distances of labels from their dots that are tried, in points."""
CLOSE = 16.0
"""Labels farther from their dots than this get a thin line to it."""

ON_LINE, ON_OTHERS, OUTSIDE = 8, 100, 1000
"""Harm of a label on the front, on each dot or label, and outside the axes, in places: a label goes
to the least harmful place, and each place is one worse than the place before it."""


@dataclass(frozen=True)
class CostDot:
    """A variant in the plane of cost and quality."""

    name: str
    """Unique in a panel."""
    label: str
    """Shown beside the dot if it is on the front."""
    color: Color
    cost: float
    quality: float
    spread: float = 0.0
    """Length of the error bar along the cost."""


@dataclass(frozen=True)
class FrontPanel:
    """A plane of cost and quality."""

    cost: str
    """Label of the cost."""
    dots: Sequence[CostDot]
    """At least one. The first is the baseline, and is drawn above the others."""
    front: Sequence[str]
    """Names of the dots on the Pareto front, by rising cost."""


@styled
def front_figure(panels: Sequence[FrontPanel], legend: Mapping[str, Color]) -> Figure:
    """Panels side by side, under one legend.

    Args:
        panels: at least one.
        legend: colours of dots by the names of their groups.
    """
    from matplotlib.lines import Line2D

    width = PANEL[0] * len(panels)
    figure = new_figure(width, PANEL[1])
    for number, panel in enumerate(panels):
        left = number * PANEL[0]
        axes = place(figure, left + LEFT, TOP, left + PANEL[0] - RIGHT, PANEL[1] - BOTTOM)
        _panel(axes, panel)
        write(figure, left + LEFT - 30, TOP - 18, QUALITY)
    dots = [Line2D([], [], color=color, marker="o", linestyle="") for color in legend.values()]
    figure.legend(
        dots,
        list(legend),
        loc="upper left",
        bbox_to_anchor=((LEFT - 34) / width, 1.0),
        ncols=len(legend),
        handletextpad=0.2,
        columnspacing=1.4,
        borderaxespad=0.8,
        borderpad=0.0,
        markerscale=1.5,
    )
    return figure


def _panel(axes: Axes, panel: FrontPanel) -> None:
    """Dots with error bars, the front as a line, and labels along it."""
    first = panel.dots[0]
    near = [dot for dot in panel.dots if _is_near(dot, first)]
    costs, qualities = [dot.cost for dot in near], [dot.quality for dot in near]
    ratio = min(costs) > 0 and max(costs) > WIDE * min(costs)
    marks = ratio_marks(min(costs), max(costs)) if ratio else round_marks(0.0, max(costs))
    mark_axis(axes, "x", marks, ratio)
    mark_axis(axes, "y", round_marks(min(qualities), max(qualities)))
    axes.set_xlabel(panel.cost, labelpad=8.0)
    if len(near) < len(panel.dots):
        note = f"{len(panel.dots) - len(near)} outside the axes"
        axes.annotate(
            *(note, (1.0, 0.0), (0.0, -34.0)),
            xycoords="axes fraction",
            textcoords="offset points",
            ha="right",
            color=FAINT,
            size=SMALL,
        )
    for dot in reversed(near):
        wings = [dot.cost - dot.spread / 2, dot.cost + dot.spread / 2]
        ends = [min(max(wing, marks[0]), marks[-1]) for wing in wings]
        axes.plot(ends, 2 * [dot.quality], color=dot.color, linewidth=1.0, zorder=3)
        (shown,) = axes.plot(
            dot.cost, dot.quality, "o", color=dot.color, markersize=6.5, zorder=4, clip_on=False
        )
        shown.set_gid(dot.name)
    by_name = {dot.name: dot for dot in near}
    front = [by_name[name] for name in panel.front if name in by_name]
    line = [(dot.cost, dot.quality) for dot in front]
    if len(line) > 1:
        axes.plot(*zip(*line, strict=True), color=FAINTER, zorder=2)
    _label(axes, front, near)


def _is_near(dot: CostDot, first: CostDot) -> bool:
    return dot.cost <= MOST_COST * first.cost and dot.quality >= first.quality - MOST_LOSS


def _label(axes: Axes, front: Sequence[CostDot], dots: Sequence[CostDot]) -> None:
    """Labels beside their dots, where no dot and no other label is; rather not on the front."""
    from matplotlib.path import Path
    from matplotlib.transforms import Bbox

    radius = 4.0 * axes.figure.dpi / 72
    taken = []
    for dot in dots:
        x, y = axes.transData.transform((dot.cost, dot.quality))
        taken.append(Bbox.from_extents(x - radius, y - radius, x + radius, y + radius))
    ends = [axes.transData.transform((dot.cost, dot.quality)) for dot in front]
    line = Path(np.array(ends).reshape(-1, 2))
    for dot in front:
        offsets = list(_offsets())
        boxes = _text_boxes(axes, dot, offsets)
        harms = [
            number
            + ON_LINE * line.intersects_bbox(box, filled=False)
            + ON_OTHERS * sum(box.overlaps(other) for other in taken)
            + OUTSIDE * (box.x0 < axes.bbox.x0 or box.x1 > axes.bbox.x1 or box.y0 < axes.bbox.y0)
            for number, box in enumerate(boxes)
        ]
        chosen = harms.index(min(harms))
        _annotation(axes, dot, offsets[chosen])
        taken.append(boxes[chosen])


def _offsets() -> Iterator[tuple[float, float]]:
    """Places of a label's nearer end relative to its dot, in points, the preferred ones first."""
    yield from ((NEAR, 0.0), (-NEAR, 0.0))
    distance = NEAR + 3.0
    while distance <= FAR:
        for reach in (0.7, 1.5):
            for rise in (-distance, distance):
                yield from ((reach * distance, rise), (-reach * distance, rise))
        distance += 7.0


def _annotation(axes: Axes, dot: CostDot, offset: tuple[float, float]) -> Annotation:
    """A label at an offset; a thin line leads to it from far away."""
    from matplotlib.patheffects import withStroke

    ahead = offset[0] > 0
    return axes.annotate(
        dot.label,
        (dot.cost, dot.quality),
        offset,
        textcoords="offset points",
        ha="left" if ahead else "right",
        va="center",
        size=SMALL,
        zorder=5,
        path_effects=[withStroke(linewidth=2.5, foreground=PAPER)],
        arrowprops={
            "arrowstyle": "-",
            "color": FAINTER,
            "linewidth": 0.7,
            "relpos": (0.0 if ahead else 1.0, 0.5),
            "shrinkA": 1.0,
            "shrinkB": 4.0,
        }
        if math.hypot(*offset) > CLOSE
        else None,
    )


def _text_boxes(axes: Axes, dot: CostDot, offsets: Sequence[tuple[float, float]]) -> list[Bbox]:
    """Pixels of the text alone at each offset: it is laid out once on each side of the dot."""
    near = {}
    for reach in (NEAR, -NEAR):
        label = _annotation(axes, dot, (reach, 0.0))  # Without a line, which would count.
        near[reach] = label.get_window_extent()
        label.remove()
    pixels = axes.figure.dpi / 72
    boxes = []
    for x, y in offsets:
        side = math.copysign(NEAR, x)
        boxes.append(near[side].translated((x - side) * pixels, y * pixels))
    return boxes
