"""Pictures: channels side by side."""

import math

import torch

from gsfw.rendering.channels import CHANNELS
from gsfw.rendering.color_maps import UNKNOWN, color_bar
from gsfw.rendering.pictures import LINE, LINE_GREY, PictureStyle, picture

COLOR, DEPTH, ERROR = (CHANNELS[name] for name in ("color", "depth", "error"))


def test_channels_are_side_by_side_with_a_bar_at_each_value():
    style = PictureStyle((COLOR, DEPTH), labels=False)
    images = [torch.rand(120, 60, 3), torch.rand(120, 60)]
    found = picture(style, images, {"depth": (0.0, 1.0)})
    bar = color_bar(120, 0.0, 1.0, DEPTH.unit)
    assert found.shape == (120, 120 + bar.shape[1], 3)
    assert torch.equal(found[:, :60], images[0])
    assert torch.equal(found[:, 120:], bar)
    plain = PictureStyle((COLOR, DEPTH), labels=False, bars=False)
    assert picture(plain, images, {"depth": (0.0, 1.0)}).shape == (120, 120, 3)


def test_a_line_parts_a_bar_from_the_next_image():
    style = PictureStyle((DEPTH, COLOR), labels=False)
    images = [torch.rand(120, 60), torch.rand(120, 60, 3)]
    found = picture(style, images, {"depth": (0.0, 1.0)})
    end = 60 + color_bar(120, 0.0, 1.0, DEPTH.unit).shape[1]
    assert bool((found[:, end : end + LINE] == LINE_GREY).all())
    assert torch.equal(found[:, end + LINE :], images[1])


def test_names_are_drawn_on_several_channels_of_some_height():
    images = [torch.ones(120, 80, 3)] * 2
    style = PictureStyle((COLOR, COLOR))
    named = picture(style, images, {})
    assert float(named[:30, :60].min()) < 0.5
    assert bool((named[60:] == 1).all())
    assert bool((picture(PictureStyle((COLOR,)), images[:1], {}) == 1).all())
    small = [image[:40] for image in images]
    assert bool((picture(style, small, {}) == 1).all())


def test_the_colour_scale_is_that_of_all_samples():
    style = PictureStyle((COLOR, DEPTH, ERROR))
    low, high = torch.full((8, 8), 1.0), torch.full((8, 8), 3.0)
    color = torch.rand(8, 8, 3)
    scales = style.scales([[color, low, low / 10], [color, high, high / 10]])
    assert scales["depth"] == (1.0, 3.0)
    assert scales["error"][0] == 0.0
    fixed = PictureStyle((DEPTH,), ends=(0.0, 9.0))
    assert fixed.scales(iter(())) == {"depth": (0.0, 9.0)}
    assert PictureStyle((COLOR,)).scales(iter(())) == {}


def test_pixels_without_a_value_are_grey():
    depth = torch.full((4, 4), math.nan)
    found = picture(PictureStyle((DEPTH,)), [depth], {"depth": (0.0, 1.0)})
    assert torch.allclose(found, torch.full((4, 4, 3), UNKNOWN))
    normals = picture(PictureStyle((CHANNELS["normals"],)), [torch.zeros(4, 4, 3)], {})
    assert torch.allclose(normals, torch.full((4, 4, 3), UNKNOWN))
