"""The census: bars in proportion, and worths on the scale of the groups."""

from dataclasses import replace

import pytest
from matplotlib.colors import to_hex

from gsfw.charts.census import LEAST_WORTH, Census, CensusRow, census_figure
from gsfw.charts.style import PAPER, png_bytes

ROWS = [
    CensusRow("positions", "#110000", 300, "300 floats", None),
    CensusRow("band 1", "#220000", 900, "900 floats", 0.5, "0.50 dB"),
    CensusRow("band 2", "#330000", 0, "left out", 2.0, "2.00 dB"),
    CensusRow("band 3", "#440000", 300, "300 floats", -0.1, "-0.10 dB"),
]
CENSUS = Census("a title", "counts", "worths", ROWS)


def widths(axes, rows=ROWS):
    """Widths of bars by colour."""
    return {to_hex(bar.get_facecolor()): bar.get_width() for bar in axes.patches}


def texts(figure):
    every = [*figure.texts, *(text for axes in figure.axes for text in axes.texts)]
    return [text.get_text() for text in every]


def test_the_stacked_bar_has_all_counts_in_order():
    stack = census_figure(CENSUS).axes[0]
    assert stack.get_xlim() == (0, 1500)
    bars = [(bar.get_x(), bar.get_width()) for bar in stack.patches]
    assert bars == [(0, 300), (300, 900), (1200, 0), (1200, 300)]


def test_every_row_has_its_name_count_and_worth():
    figure = census_figure(CENSUS)
    found = texts(figure)
    assert {"a title", "counts", "worths", "not measured", "2.00 dB", "left out"} <= set(found)
    assert all(row.name in found and row.note in found for row in ROWS)
    _, counts, worths = figure.axes
    assert widths(counts)["#220000"] == 900
    assert widths(worths)["#440000"] == pytest.approx(-0.1)


def test_a_worth_beyond_those_of_the_groups_is_cut_off_and_marked_by_a_gap():
    worths = census_figure(CENSUS).axes[2]
    assert worths.get_xlim() == (-0.1, 0.5)
    assert widths(worths)["#330000"] == 0.5
    assert PAPER in widths(worths)
    assert PAPER not in widths(census_figure(replace(CENSUS, rows=ROWS[:2])).axes[2])


def test_small_worths_do_not_fill_the_axis():
    rows = [replace(ROWS[1], worth=0.01)]
    assert census_figure(replace(CENSUS, rows=rows)).axes[2].get_xlim() == (0.0, LEAST_WORTH)


def test_shares_and_a_curve_are_drawn_below_where_there_are_any():
    bare = census_figure(CENSUS)
    shares = [("degree 0", 25, "25"), ("degree 1", 75, "75")]
    with_shares = census_figure(replace(CENSUS, shares_title="by degree", shares=shares))
    assert with_shares.get_figheight() > bare.get_figheight()
    axes = with_shares.axes[-1]
    assert [bar.get_width() / axes.get_xlim()[1] for bar in axes.patches] == [0.25, 0.75]
    assert {"by degree", "degree 0", "75"} <= set(texts(with_shares))
    points = [(0.0, 10.0), (100.0, 2e6)]
    curve = census_figure(replace(CENSUS, curve_title="by step", curve=points)).axes[-1]
    assert [tuple(point) for point in curve.lines[0].get_xydata()] == points
    assert [text.get_text() for text in curve.get_yticklabels()][-1] == "2M"


def test_names_do_not_reach_into_the_bars():
    figure = census_figure(replace(CENSUS, rows=[replace(ROWS[0], name="the least useful 25 %")]))
    figure.draw_without_rendering()
    (name,) = [text for text in figure.texts if text.get_text().startswith("the least")]
    assert name.get_window_extent().x1 < figure.axes[1].get_window_extent().x0


def test_a_total_of_nothing_is_drawn():
    rows = [replace(ROWS[0], count=0)]
    assert png_bytes(census_figure(replace(CENSUS, rows=rows, curve=[(3.0, 0.0)])))
