"""Colour maps: values as colours, and the bar that explains them."""

import math
from typing import get_args, get_type_hints

import pytest
import torch

from gsfw.commands.render import RenderOptions
from gsfw.rendering.color_maps import UNKNOWN, color_bar, colored, value_range


def test_the_range_leaves_outliers_and_unknown_values_out():
    values = torch.linspace(1, 2, 1000)
    values[0], values[1], values[2] = -1e6, 1e6, math.nan
    low, high = value_range(values)
    assert (low, high) == pytest.approx((1.0, 2.0), abs=0.05)


def test_given_ends_stay():
    values = torch.linspace(1, 2, 1000)
    assert value_range(values, low=0.0)[0] == 0
    assert value_range(values, 0.0, 5.0) == (0, 5)


@pytest.mark.parametrize("value", [0.0, 7.0, -3.0])
def test_one_value_has_a_range_around_it(value):
    low, high = value_range(torch.full((4, 4), value))
    assert low < value < high
    low, high = value_range(torch.full((4, 4), value), low=value)
    assert low == value < high


def test_no_values_have_a_range_too():
    assert value_range(torch.full((2, 2), math.nan)) == (0.0, 1.0)
    assert value_range(torch.zeros(0)) == (0.0, 1.0)


def test_colours_run_through_the_map_and_unknown_pixels_are_grey():
    values = torch.tensor([[-1.0, 0.0, 0.5, 1.0, 9.0, math.nan, math.inf]])
    found = colored(values, 0.0, 1.0, "gray")[0]
    assert torch.equal(found[0], found[1])
    assert torch.equal(found[3], found[4])
    assert found[:, 0].tolist() == pytest.approx([0, 0, 0.5, 1, 1, UNKNOWN, UNKNOWN], abs=0.01)


@pytest.mark.parametrize("name", get_args(get_type_hints(RenderOptions)["colormap"])[1:])
def test_every_map_has_many_colours(name):
    ramp = colored(torch.linspace(0, 1, 256)[None], 0.0, 1.0, name)[0]
    assert len(ramp.unique(dim=0)) > 200


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.0, 1.0), (2.93, 3.07), (0.0, 250.0), (-1e-6, 1e-6), (0.0, 1e7), (3.0, 3.0001)],
)
@pytest.mark.parametrize("height", [12, 120, 720])
def test_a_bar_has_the_height_that_is_asked_for(low, high, height):
    bar = color_bar(height, low, high, "scene units")
    assert bar.shape[0] == height
    assert 0 <= float(bar.min()) <= float(bar.max()) <= 1


def test_the_bar_shows_the_largest_value_at_the_top():
    bar = color_bar(200, 0.0, 1.0, colormap="gray")
    column = bar[:, 12, 0]
    assert float(column[15]) > 0.9
    assert float(column[-15]) < 0.1
