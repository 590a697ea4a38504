"""Chart: lines over one quantity as inline SVG in the colours of the page; values on hover."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

from gsfw.charts.style import ratio_marks, round_marks
from gsfw.core.words import brief
from gsfw.reports.markup import Markup, div, element, span

WIDTH, HEIGHT = 400.0, 225.0
LEFT, TOP, RIGHT, BOTTOM = 46.0, 10.0, 12.0, 36.0
"""Margins of the plot, in units of the drawing."""

MOST_POINTS = 300
"""Points of a line; longer ones are thinned, so that pages stay small."""

FLAT = 0.02
"""Least height of a vertical axis, as a part of its largest value."""

COLORS = 6
"""Number of colours of lines in the style of the page; they repeat."""

Point = tuple[float, float]


@dataclass(frozen=True)
class Curve:
    """One line."""

    name: str
    points: Sequence[Point]
    color: int = 0
    """Place in the colours of the page."""
    style: str = "solid"
    """``solid``, ``faint`` (raw values behind a mean), ``dashed`` (a level), or ``dots``: a line
    with a dot at each point."""


@dataclass(frozen=True)
class Chart:
    """Lines with their axes."""

    title: str
    across: str
    """Label of the horizontal axis."""
    curves: tuple[Curve, ...]
    unit: str = ""
    is_ratio: bool = False
    """True for a logarithmic vertical axis; all values are above 0."""
    is_from_zero: bool = False
    """True for a vertical axis that begins at 0; no value is below."""

    def markup(self) -> Markup:
        """The chart; nothing without points."""
        curves = [
            Curve(curve.name, thinned(curve.points), curve.color, curve.style)
            for curve in self.curves
            if curve.points
        ]
        if not curves:
            return Markup("")
        frame = _Frame.around(curves, self.is_ratio, self.is_from_zero)
        drawn = [*frame.axes(self.across), *(_line(curve, frame) for curve in curves)]
        named = [curve for curve in curves if curve.style != "faint"]
        attributes = {
            "viewBox": f"0 0 {WIDTH:g} {HEIGHT:g}",
            "role": "img",
            "aria-label": f"{self.title}: {', '.join(curve.name for curve in named)}",
            "data-chart": json.dumps(frame.hover(named, self.unit), separators=(",", ":")),
        }
        keys = [
            span(f"key c{curve.color % COLORS} {curve.style}", curve.name)
            for curve in named
            if curve.name != self.title
        ]
        title = f"{self.title} ({self.unit})" if self.unit else self.title
        head = element("figcaption", [element("strong", title), *keys])
        plot = div("plot", [element("svg", drawn, attributes), div("tip")])
        return element("figure", [head, plot], {"class": "chart"})


def thinned(points: Sequence[Point], most: int = MOST_POINTS) -> list[Point]:
    """At most ``most`` points: the first and the last one as they are, means of neighbours between.

    A curve so begins and ends at true values: its end is what people read.
    """
    if len(points) <= most:
        return list(points)
    inner = points[1:-1]
    each = -(-len(inner) // (most - 2))
    groups = [inner[start : start + each] for start in range(0, len(inner), each)]
    return [points[0], *map(_mean, groups), points[-1]]


def _mean(points: Sequence[Point]) -> Point:
    return sum(x for x, _ in points) / len(points), sum(y for _, y in points) / len(points)


def smoothed(points: Sequence[Point], share: float = 0.05) -> list[Point]:
    """Means over a window of ``share`` of the points around each."""
    half = max(round(len(points) * share / 2), 1)
    values = [value for _, value in points]
    lowest, highest = min(values, default=0.0), max(values, default=0.0)
    sums, found = list(accumulate(values, initial=0.0)), []
    for place, (x, _) in enumerate(points):
        reach = min(half, place, len(points) - 1 - place)
        first, end = place - reach, place + reach + 1
        mean = (sums[end] - sums[first]) / (end - first)
        # Beside a huge value the difference of sums is wrong: it may be below zero.
        found.append((x, min(max(mean, lowest), highest)))
    return found


@dataclass(frozen=True)
class _Frame:
    """The ranges of the axes, and the places of values in the drawing."""

    low: Point
    high: Point
    across_marks: tuple[float, ...]
    upward_marks: tuple[float, ...]
    is_ratio: bool

    @staticmethod
    def around(curves: Sequence[Curve], is_ratio: bool, is_from_zero: bool) -> _Frame:
        """The frame of some lines; levels stretch it upward only."""
        points = [point for curve in curves for point in curve.points]
        xs, ys = [x for x, _ in points], [y for _, y in points]
        lowest = min(0.0, *ys) if is_from_zero else min(ys)
        upward = _upward_marks(lowest, max(ys), is_ratio)
        left, right = float(min(xs)), float(max(xs))
        if left == right:  # A half is nothing beside 1e18.
            room = max(0.5, FLAT * abs(left))
            left, right = left - room, right + room
        across = [mark for mark in round_marks(left, right, 6) if left <= mark <= right]
        shown = [mark for mark in upward if _digit(mark) == 1] if is_ratio else upward
        shown = shown if len(shown) > 1 else upward
        ends = (left, upward[0]), (right, upward[-1])
        return _Frame(*ends, tuple(across), tuple(shown), is_ratio)

    def place(self, point: Point) -> Point:
        """Place of a point in the drawing."""
        x = (point[0] - self.low[0]) / (self.high[0] - self.low[0])
        low, high, value = (self._height(y) for y in (self.low[1], self.high[1], point[1]))
        y = (value - low) / (high - low)
        return LEFT + x * (WIDTH - LEFT - RIGHT), HEIGHT - BOTTOM - y * (HEIGHT - TOP - BOTTOM)

    def _height(self, value: float) -> float:
        return math.log(value) if self.is_ratio else value

    def axes(self, across: str) -> list[Markup]:
        """Grid lines, their values and the name of the horizontal axis."""
        drawn = []
        for mark in self.upward_marks:
            _, y = self.place((self.low[0], mark))
            drawn.append(_straight("grid", LEFT, y, WIDTH - RIGHT, y))
            drawn.append(_text(LEFT - 7, y + 3.5, brief(mark), "end"))
        for mark in self.across_marks:
            x, _ = self.place((mark, self.low[1]))
            drawn.append(_straight("tick", x, HEIGHT - BOTTOM, x, HEIGHT - BOTTOM + 4))
            drawn.append(_text(x, HEIGHT - BOTTOM + 15, brief(mark), "middle"))
        drawn.append(_text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 4, across, "middle"))
        return drawn

    def hover(self, curves: Sequence[Curve], unit: str) -> dict[str, object]:
        """Data with which the script of the page shows values."""
        return {
            "box": [LEFT, TOP, WIDTH - RIGHT, HEIGHT - BOTTOM],
            "size": [WIDTH, HEIGHT],
            "low": self.low,
            "high": self.high,
            "ratio": self.is_ratio,
            "unit": unit,
            "curves": [
                {
                    "name": curve.name,
                    "color": curve.color % COLORS,
                    "points": [[_short(x), _short(y)] for x, y in curve.points],
                }
                for curve in curves
            ],
        }


def _line(curve: Curve, frame: _Frame) -> Markup:
    """A line, with dots where they are asked for."""
    places = [frame.place(point) for point in curve.points]
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    look = f"curve c{curve.color % COLORS} {curve.style}"
    drawn = [element("polyline", (), {"class": look, "points": path})]
    if curve.style == "dots" or len(places) == 1:
        drawn += [
            element("circle", (), {"class": look, "cx": f"{x:.1f}", "cy": f"{y:.1f}", "r": 2.5})
            for x, y in places
        ]
    return element("g", drawn)


def _straight(look: str, x1: float, y1: float, x2: float, y2: float) -> Markup:
    ends = {"x1": x1, "y1": y1, "x2": x2, "y2": y2}
    return element("line", (), {"class": look, **{key: f"{end:.1f}" for key, end in ends.items()}})


def _text(x: float, y: float, text: str, anchor: str) -> Markup:
    return element("text", text, {"x": f"{x:.1f}", "y": f"{y:.1f}", "text-anchor": anchor})


def _upward_marks(low: float, high: float, is_ratio: bool) -> list[float]:
    """Marks around all values; at least two."""
    if not is_ratio:
        # A flat curve has room around it: marks so near that they read alike tell nothing.
        room = max(FLAT * max(abs(low), abs(high)) - (high - low), 0.0) / 2
        return round_marks(low - room, high + room, 5)
    marks = ratio_marks(low, high)
    return marks if len(marks) > 1 else [marks[0] / 2, marks[0] * 2]


def _digit(mark: float) -> int:
    return int(f"{mark:e}"[0])


def _short(value: float) -> float:
    return float(f"{value:.5g}")
