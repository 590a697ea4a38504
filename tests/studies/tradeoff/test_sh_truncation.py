"""Leaving out SH bands is the same as setting their coefficients to zero."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.splats import Sh
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.tradeoff.edits import ShTruncation, sh_degree


def of_mixed_degrees(splats):
    """The same splats with degrees 0 to 3 in turn."""
    return replace(splats, colors=splats.colors.of_degrees(torch.arange(len(splats)) % 4))


def in_two_parts(splats):
    """The same splats with their constant coefficients apart, as models keep them."""
    both = splats.colors.coefficients
    return replace(splats, colors=Sh(both[:, :1], 3, rest=both[:, 1:]))


@pytest.mark.parametrize("form", [lambda splats: splats, in_two_parts, of_mixed_degrees])
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_truncation_draws_what_zeroed_coefficients_draw(form, degree):
    splats = form(random_splats(12, degree=3))
    cut = ShTruncation(degree)(splats)
    zeroed = splats.colors.dense().clone()
    zeroed[:, (degree + 1) ** 2 :] = 0
    rasterizer, camera = ReferenceRasterizer(), front_camera()
    expected = rasterizer.render(replace(splats, colors=Sh(zeroed, 3)), camera).color
    torch.testing.assert_close(rasterizer.render(cut, camera).color, expected, atol=1e-6, rtol=0)
    assert sh_degree(cut) == degree


def test_ragged_colours_lose_only_what_is_above_the_degree():
    splats = of_mixed_degrees(random_splats(12, degree=3))
    cut = ShTruncation(1)(splats)
    assert cut.colors.offsets.diff().tolist() == [0, 3, 3, 3] * 3
    torch.testing.assert_close(cut.colors.dense(), splats.colors.dense()[:, :4])


def test_colours_of_no_higher_degree_and_channels_stay_as_they_are():
    splats = random_splats(5, degree=1)
    assert ShTruncation(2)(splats) is splats
    channels = replace(splats, colors=torch.rand(5, 3))
    assert ShTruncation(0)(channels) is channels
    assert sh_degree(channels) == 0
