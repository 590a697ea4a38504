"""Heat maps: one logarithmic colour scale, with colours for empty and for broken cells."""

import math

import numpy as np
import pytest
from matplotlib.colors import to_hex

from gsfw.charts.heat_map import NOT_FINITE, NOTHING, SCALE, HeatPanel, heat_figure
from gsfw.charts.style import png_bytes


def panel(errors, across=(1.0, 10.0), upward=(0.5, 2.0)):
    return HeatPanel("a title", "scale", "depth", across, upward, errors)


def color_of(error) -> str:
    axes = heat_figure([[panel([[error]], (1.0,), (1.0,))]]).axes[0]
    (image,) = axes.images
    return to_hex(image.cmap(image.norm(image.get_array()))[0, 0])


def near(first, second):
    values = [[int(color[at : at + 2], 16) for at in (1, 3, 5)] for color in (first, second)]
    return np.abs(np.subtract(*values)).max() <= 2


def test_colours_go_by_powers_of_ten():
    assert near(color_of(1.0), SCALE[-1][1])
    assert color_of(5.0) == color_of(1.0)
    assert color_of(0.0) == color_of(1e-30) == SCALE[0][1]
    assert near(color_of(1e-5), SCALE[3][1])


def test_empty_cells_and_cells_that_are_not_finite_have_their_own_colours():
    assert color_of(None) == NOTHING
    assert color_of(math.nan) == color_of(math.inf) == NOT_FINITE


def test_rows_go_up_and_columns_to_the_right():
    axes = heat_figure([[panel([[1e-1, 1e-2], [1e-3, None]])]]).axes[0]
    (image,) = axes.images
    assert image.origin == "lower"
    assert image.get_array()[:, 0].tolist() == pytest.approx([-1.0, -3.0])
    assert axes.get_xlabel() == "scale"
    assert [text.get_text() for text in axes.get_xticklabels()] == ["1", "10"]
    assert [text.get_text() for text in axes.get_yticklabels()] == ["0.5", "2"]


def test_many_values_are_labelled_at_powers_of_ten():
    across = tuple(10.0 ** (power / 2) for power in range(-6, 13))
    axes = heat_figure([[panel([[1e-3] * len(across)], across, (1.0,))]]).axes[0]
    labels = [text.get_text() for text in axes.get_xticklabels()]
    assert labels == ["1e-3", "0.1", "10", "1e3", "1e5"]


def test_every_panel_has_its_title_and_the_figure_one_colour_bar():
    figure = heat_figure([[panel([[1.0, 1.0]] * 2)] * 4, [panel([[1.0, 1.0]] * 2)] * 2])
    assert len(figure.axes) == 4 + 2 + 1
    texts = [text.get_text() for text in figure.texts]
    assert texts.count("a title") == texts.count("up: depth") == 6
    bar = figure.axes[-1]
    assert [text.get_text() for text in bar.get_xticklabels()][-2:] == ["1e-2", "1e0"]
    assert png_bytes(figure)
