"""Panels of lines: scales, ticks, colours and the legend."""

from dataclasses import replace

import pytest
from matplotlib.colors import to_hex

from gsfw.charts.lines import Line, LinePanel, line_figure
from gsfw.charts.style import SERIES, png_bytes

ONE = Line("one", ((1.0, 10.0), (2.0, 100.0), (4.0, 1000.0)))
LEVEL = Line("two", ((1.0, 20.0), (4.0, 20.0)), dashed=True)


def labels(ticks):
    return [tick.get_text() for tick in ticks]


def test_points_are_drawn_and_axes_are_labelled():
    (axes,) = line_figure([LinePanel("a title", "x", (ONE, LEVEL), upward="y")]).axes
    assert (axes.get_title(), axes.get_xlabel(), axes.get_ylabel()) == ("a title", "x", "y")
    first, level = axes.lines
    assert [tuple(point) for point in first.get_xydata()] == list(ONE.points)
    assert (first.get_linestyle(), first.get_marker()) == ("-", "o")
    assert (level.get_linestyle(), level.get_marker()) == ("--", "")
    assert axes.get_xlim() == (1.0, 4.0)


def test_doubling_and_decades_have_logarithmic_axes():
    (axes,) = line_figure([LinePanel("", "x", (ONE,), doubling=True, decades=True)]).axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert labels(axes.get_xticklabels()) == ["1", "2", "4"]
    assert labels(axes.get_yticklabels()) == ["10", "100", "1000"]


def test_values_within_a_decade_have_ticks_too():
    line = Line("a", ((1.0, 15.0), (2.0, 45.0)))
    (axes,) = line_figure([LinePanel("", "x", (line,), decades=True)]).axes
    assert labels(axes.get_yticklabels()) == ["10", "20", "50"]


def test_many_doublings_label_every_other_point():
    line = Line("a", tuple((2.0**number, 1.0) for number in range(9)))
    (axes,) = line_figure([LinePanel("", "x", (line,), doubling=True)]).axes
    assert labels(axes.get_xticklabels()) == ["1", "4", "16", "64", "256"]


def test_a_name_has_one_colour_in_all_panels_and_one_entry_in_the_legend():
    panels = [LinePanel("", "x", (ONE, LEVEL)), LinePanel("", "x", (LEVEL,))]
    figure = line_figure(panels)
    left, right = figure.axes
    assert to_hex(left.lines[1].get_color()) == to_hex(right.lines[0].get_color()) == SERIES[1]
    (legend,) = figure.legends
    assert labels(legend.get_texts()) == ["one", "two"]


def test_a_colour_can_be_given():
    line = replace(ONE, color="#123456")
    (axes,) = line_figure([LinePanel("", "x", (line,))]).axes
    assert to_hex(axes.lines[0].get_color()) == "#123456"


@pytest.mark.parametrize(
    "points",
    [((0.0, 5.0),), ((0.0, 5.0), (1.0, 5.0)), ((2.0, 1.0), (2.0, 3.0)), ((0.1, -4.0), (9.0, 7.0))],
)
def test_points_without_extent_still_have_an_axis(points):
    figure = line_figure([LinePanel("", "x", (Line("a", points),))])
    (axes,) = figure.axes
    low, high = axes.get_ylim()
    assert low < high
    assert png_bytes(figure)


def test_a_ratio_axis_has_round_ticks_around_the_points():
    line = Line("a", ((3.0, 1.0), (40.0, 2.0)))
    (axes,) = line_figure([LinePanel("", "x", (line,), ratio=True)]).axes
    assert axes.get_xscale() == "log"
    assert labels(axes.get_xticklabels()) == ["2", "5", "10", "20", "50"]


@pytest.mark.parametrize("length", [3, 12, 20])
def test_the_legend_stays_within_the_figure(length):
    lines = [replace(ONE, name=letter * length) for letter in "mnop"]
    figure = line_figure([LinePanel("", "x", tuple(lines))], columns=3)
    figure.draw_without_rendering()
    (legend,) = figure.legends
    assert legend.get_window_extent().x1 <= figure.bbox.x1
    assert legend.get_window_extent().y0 >= figure.axes[0].bbox.y1
