"""The dot plot: every dot at its place, with its spread and the colour of its row."""

import pytest
from matplotlib.colors import to_hex

from gsfw.charts.dots import WIDTH, Dot, Group, dot_figure
from gsfw.charts.style import SERIES, UNITS, png_bytes

GROUPS = [
    Group("balls", {"still": {"psnr": Dot(20.0)}, "moves": {"psnr": Dot(25.0, 0.7)}}),
    Group("boxes", {"moves": {"psnr": Dot(31.0), "ssim": Dot(0.9)}}),
]
PANELS = {"psnr": "PSNR (dB)", "ssim": "SSIM"}


def dots_of(axes):
    """Place and colour of each dot."""
    lines = [line for line in axes.lines if line.get_marker() == "o"]
    return [(*line.get_xydata()[0], to_hex(line.get_color())) for line in lines]


def test_every_dot_is_drawn_in_the_panel_of_its_metric():
    psnr, ssim = dot_figure(GROUPS, PANELS).axes
    assert (psnr.get_title(), ssim.get_title()) == ("PSNR (dB)", "SSIM")
    assert [x for x, _, _ in dots_of(psnr)] == [20.0, 25.0, 31.0]
    assert [x for x, _, _ in dots_of(ssim)] == [0.9]
    assert dots_of(ssim)[0][1] == dots_of(psnr)[2][1], "a row is at one height in all panels"
    heights = [y for _, y, _ in dots_of(psnr)]
    assert heights == sorted(heights), "rows go down, and y with them"


def test_a_row_has_one_colour_in_all_groups():
    psnr, _ = dot_figure(GROUPS, PANELS).axes
    assert [color for _, _, color in dots_of(psnr)] == [SERIES[0], SERIES[1], SERIES[1]]


def test_spreads_are_bars_of_that_length_on_both_sides():
    psnr, _ = dot_figure(GROUPS, PANELS).axes
    (bar,) = [path for lines in psnr.collections for path in lines.get_segments()]
    assert bar[:, 0] == pytest.approx([24.3, 25.7])


def test_names_of_groups_and_rows_are_beside_the_panels():
    figure = dot_figure(GROUPS, PANELS)
    assert [text.get_text() for text in figure.texts] == [
        *("balls", "boxes"),
        *("still", "moves", "moves"),
    ]
    figure.draw_without_rendering()
    left = min(axes.get_window_extent().x0 for axes in figure.axes)
    assert all(text.get_window_extent().x0 >= 0 for text in figure.texts)
    assert all(text.get_window_extent().x1 <= left for text in figure.texts)


def test_long_names_widen_the_figure_instead_of_covering_the_panels():
    groups = [Group("a", {"x" * 200: {"psnr": Dot(1.0)}})]
    figure = dot_figure(groups, {"psnr": "PSNR"})
    assert figure.get_figwidth() * UNITS > WIDTH
    figure.draw_without_rendering()
    name = figure.texts[1].get_window_extent()
    assert name.x0 >= 0
    assert name.x1 <= figure.axes[0].get_window_extent().x0


def test_equal_dots_have_an_axis():
    assert png_bytes(dot_figure([Group("a", {"b": {"psnr": Dot(3.0, 0.0)}})], {"psnr": "PSNR"}))
