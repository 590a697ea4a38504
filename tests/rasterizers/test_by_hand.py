"""The conventions of splatting, each pinned by an image that can be worked out on paper."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from support.flat_scenes import dots, flat_camera, leaves

from gsfw.core.numerics import DEFAULT, GSPLAT_1_5
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats

NEIGHBOUR = math.exp(-0.5 / 0.3)
"""Falloff of a dot one pixel from its centre: the dilation is its variance."""


@pytest.fixture
def draw(rasterizer) -> Callable[..., RenderOutput]:
    """Draw a scene laid out in pixels."""

    def draw(splats: Splats, settings: RenderSettings | None = None, size: int = 5) -> RenderOutput:
        return rasterizer.render(splats, flat_camera(size, size), settings)

    return draw


def test_pixel_centres_are_at_one_half(draw):
    color = draw(dots([[2.5, 1.5, 1.0]], [0.8])).color[0, :, :, 0]
    assert color[1, 2].item() == pytest.approx(0.8, rel=1e-12)
    assert color[1, 3].item() == pytest.approx(0.8 * NEIGHBOUR, rel=1e-12)
    assert color[0, 1].item() == pytest.approx(0.8 * NEIGHBOUR**2, rel=1e-12)


def test_alpha_below_one_in_255_is_not_drawn(draw):
    color = draw(dots([[2.5, 2.5, 1.0]], [0.8])).color[0, :, :, 0]
    assert 0.8 * NEIGHBOUR**4 < 1 / 255
    assert color[2, 4].item() == 0.0
    faint = draw(dots([[2.5, 2.5, 1.0]], [1 / 255 - 1e-9]))
    assert not faint.statistics.visible.any()
    assert faint.alpha.abs().max() == 0
    just = draw(dots([[2.5, 2.5, 1.0]], [1 / 255]))
    assert just.alpha[0, 2, 2].item() == pytest.approx(1 / 255)


@pytest.mark.parametrize(("profile", "limit"), [(DEFAULT, 0.99), (GSPLAT_1_5, 0.999)])
def test_alpha_is_clamped_and_has_no_gradient_there(draw, profile, limit):
    splats = leaves(dots([[2.5, 2.5, 1.0]], [1.0]))
    background = torch.tensor([3.0], dtype=torch.float64)
    output = draw(splats, RenderSettings(profile=profile, background=background))
    centre = output.color[0, 2, 2, 0]
    assert centre.item() == pytest.approx(limit * 1 + (1 - limit) * 3, rel=1e-12)
    centre.backward()
    assert splats.opacities.grad is not None
    assert splats.opacities.grad.item() == 0.0
    assert isinstance(splats.colors, torch.Tensor)
    assert splats.colors.grad is not None
    assert splats.colors.grad.item() == pytest.approx(limit, rel=1e-12)


def test_alpha_exactly_at_the_clamp_keeps_its_gradient(draw):
    splats = leaves(dots([[2.5, 2.5, 1.0]], [0.99]))
    draw(splats).color[0, 2, 2, 0].backward()
    assert splats.opacities.grad is not None
    assert splats.opacities.grad.item() == pytest.approx(1.0)


def test_the_splat_that_would_stop_the_pixel_is_not_drawn_nor_any_behind(draw):
    # Transmittance: 0.01, then 1.1e-4; the third would bring it to 5.5e-5, the fourth to 1.05e-4.
    splats = leaves(dots([[2.5, 2.5, z] for z in (1.0, 2.0, 3.0, 4.0)], [0.99, 0.989, 0.5, 0.05]))
    output = draw(splats)
    expected = 0.99 * 1 + 0.01 * 0.989 * 2
    assert output.color[0, 2, 2, 0].item() == pytest.approx(expected, rel=1e-12)
    assert 1 - output.alpha[0, 2, 2, 0].item() == pytest.approx(1.1e-4, rel=1e-9)
    output.color[0, 2, 2, 0].backward()
    assert splats.opacities.grad is not None
    assert splats.opacities.grad[2:].tolist() == [0.0, 0.0]
    assert splats.opacities.grad[1].item() == pytest.approx(0.01 * 2)
    assert splats.opacities.grad[0].item() == pytest.approx(1 - 0.989 * 2)


@pytest.mark.parametrize(("opacity", "drawn"), [(0.9895, True), (0.9901, False)])
def test_the_stop_is_exclusive_just_above_and_below(draw, opacity, drawn):
    profile = replace(DEFAULT, alpha_max=0.9999)
    splats = dots([[2.5, 2.5, 1.0], [2.5, 2.5, 2.0]], [0.99, opacity])
    color = draw(splats, RenderSettings(profile=profile)).color[0, 2, 2, 0].item()
    assert color == pytest.approx(0.99 + (0.01 * opacity * 2 if drawn else 0.0))


def test_a_transmittance_of_exactly_the_limit_stops(draw):
    profile = replace(DEFAULT, transmittance_min=0.25)
    splats = dots([[2.5, 2.5, 1.0], [2.5, 2.5, 2.0]], [0.5, 0.5])
    color = draw(splats, RenderSettings(profile=profile)).color[0, 2, 2, 0].item()
    assert color == pytest.approx(0.5)


def test_near_and_far_planes_are_inclusive_and_nothing_behind_is_drawn(draw):
    depths = [0.01, 0.0099, 0.0, -1.0, 50.0, 50.1]
    splats = dots([[2.5, 2.5, z] for z in depths], [0.1] * 6)
    visible = draw(splats, RenderSettings(far=50.0)).statistics.visible[0]
    assert visible.tolist() == [True, False, False, False, True, False]
    open_ended = draw(splats, RenderSettings(near=-10.0)).statistics.visible[0]
    assert open_ended.tolist() == [True, True, False, False, True, True]


@pytest.mark.parametrize(("scale", "factor"), [(1.0, 1 / 1.3), (0.4, 0.16 / 0.46), (0.0, 0.005)])
def test_antialiasing_scales_opacity_by_what_dilation_adds(draw, scale, factor):
    splats = replace(
        dots([[2.5, 2.5, 1.0]], [0.9]), scales=torch.tensor([[scale] * 3], dtype=torch.float64)
    )
    output = draw(splats, RenderSettings(antialias=True))
    assert output.alpha[0, 2, 2, 0].item() == pytest.approx(0.9 * factor, rel=1e-9)


def test_the_antialiasing_factor_has_a_gradient_above_its_floor_and_none_at_it(draw):
    for scale, slope in [(0.4, 2 * 0.4 * 0.3 / 0.46**2), (0.001, 0.0)]:
        splats = replace(
            dots([[2.5, 2.5, 1.0]], [0.9]), scales=torch.tensor([[scale] * 3], dtype=torch.float64)
        )
        splats = leaves(splats)
        draw(splats, RenderSettings(antialias=True)).alpha[0, 2, 2, 0].backward()
        assert splats.scales is not None
        assert splats.scales.grad is not None
        assert splats.scales.grad.sum().item() == pytest.approx(0.9 * slope)


def test_the_background_shows_through_what_is_left(draw):
    background = torch.tensor([7.0], dtype=torch.float64)
    color = draw(dots([[2.5, 2.5, 1.0]], [0.75]), RenderSettings(background=background)).color
    assert color[0, 2, 2, 0].item() == pytest.approx(0.75 * 1 + 0.25 * 7)
    assert color[0, 0, 0, 0].item() == pytest.approx(7.0)


def test_depth_is_expected_or_accumulated(draw):
    splats = dots([[2.5, 2.5, 2.0], [2.5, 2.5, 6.0]], [0.5, 0.5])
    expected = draw(splats, RenderSettings(depth=Depth.EXPECTED)).depth
    accumulated = draw(splats, RenderSettings(depth=Depth.ACCUMULATED)).depth
    assert expected is not None
    assert accumulated is not None
    assert accumulated[0, 2, 2, 0].item() == pytest.approx(0.5 * 2 + 0.25 * 6)
    assert expected[0, 2, 2, 0].item() == pytest.approx((0.5 * 2 + 0.25 * 6) / 0.75)
    assert expected[0, 0, 0, 0].item() == 0.0
    assert draw(splats).depth is None


def test_extra_channels_are_drawn_over_zero(draw):
    splats = replace(
        dots([[2.5, 2.5, 2.0]], [0.5]), extra=torch.tensor([[4.0, -2.0]], dtype=torch.float64)
    )
    background = torch.tensor([7.0], dtype=torch.float64)
    extra = draw(splats, RenderSettings(background=background)).extra
    assert extra is not None
    assert extra[0, 2, 2].tolist() == pytest.approx([2.0, -1.0])
    assert extra[0, 0, 0].tolist() == [0.0, 0.0]
    assert draw(dots([[2.5, 2.5, 2.0]], [0.5])).extra is None


def test_equal_depths_are_drawn_in_row_order(draw):
    color = draw(dots([[2.5, 2.5, 1.0]] * 3, [0.5] * 3)).color
    assert color[0, 2, 2, 0].item() == pytest.approx(0.5 * 1 + 0.25 * 2 + 0.125 * 3)


def test_statistics_say_who_is_seen_how_large_and_by_how_much(draw):
    wanted = frozenset(Statistic)
    splats = leaves(dots([[2.5, 2.5, 1.0], [2.2, 2.5, 2.0], [20.0, 2.5, 1.0]], [0.5, 0.5, 0.5]))
    output = draw(splats, RenderSettings(statistics=wanted))
    statistics = output.statistics
    radius = math.sqrt(2 * math.log(0.5 * 255) * 0.3)
    assert statistics.visible[0].tolist() == [True, True, False]
    assert statistics.radii[0].tolist() == pytest.approx([radius, radius, 0.0])
    assert statistics.contribution is not None
    assert statistics.contribution[0].sum().item() == pytest.approx(output.alpha.sum().item())
    assert statistics.contribution[0, 2].item() == 0.0
    for measured in (statistics.screen_gradient, statistics.absgrad):
        assert measured is not None
        assert measured.abs().max() == 0, "zero until backward"

    (output.color[0, 2, 2, 0] * 3).backward()
    # At its own centre the first does not move the pixel; the second does, by alpha dx / variance.
    alpha = 0.5 * math.exp(-0.5 * 0.3**2 / 0.3)
    gradient = 3 * 2 * 0.5 * alpha * 0.3 / 0.3 * (5 / 2)
    for measured in (statistics.screen_gradient, statistics.absgrad):
        assert measured is not None
        assert measured[0].tolist() == pytest.approx([0.0, gradient, 0.0])


def test_absgrad_does_not_let_pixels_cancel(draw):
    splats = leaves(dots([[2.5, 2.5, 1.0]], [0.5]))
    output = draw(splats, RenderSettings(statistics=frozenset(Statistic)))
    output.color.sum().backward()
    statistics = output.statistics
    assert statistics.screen_gradient is not None
    assert statistics.absgrad is not None
    assert statistics.screen_gradient[0, 0].item() == pytest.approx(0.0, abs=1e-12)
    # By symmetry sum |dx| alpha / variance is the same along both axes.
    near = 0.5 * (2 * NEIGHBOUR + 4 * NEIGHBOUR**2) / 0.3
    assert statistics.absgrad[0, 0].item() == pytest.approx(math.hypot(near, near) * 5 / 2)


def test_statistics_not_asked_for_are_none(draw):
    statistics = draw(dots([[2.5, 2.5, 1.0]], [0.5])).statistics
    assert statistics.screen_gradient is None
    assert statistics.absgrad is None
    assert statistics.contribution is None


def test_a_bounding_box_that_only_touches_the_image_is_not_visible(draw):
    radius = math.sqrt(2 * math.log(0.5 * 255) * 0.3)
    inside = dots([[-radius + 1e-6, 2.5, 1.0]], [0.5])
    outside = dots([[-radius - 1e-6, 2.5, 1.0]], [0.5])
    assert draw(inside).statistics.visible.all()
    assert not draw(outside).statistics.visible.any()
