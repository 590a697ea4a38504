"""Extremes of which more is known than how near to the reference they must be."""

from dataclasses import replace

import pytest
import torch
from support.finite_drawings import EVERYTHING, draw_and_check
from support.scenes import front_camera, random_splats

from gsfw.core.render_settings import RenderSettings, Statistic
from gsfw.core.splats import Sh, Splats
from gsfw.studies.stress.catalogue.splats import scaled
from gsfw.studies.stress.catalogue.views import camera_with


@pytest.mark.parametrize("size", [(1, 1), (1, 4096), (4096, 1), (17, 31), (8, 8), (9, 7)])
@pytest.mark.parametrize("count", [0, 1, 20])
def test_every_image_size_is_drawn(rasterizer, size, count):
    width, height = size
    camera = camera_with(3.0)(front_camera(width, height))
    splats = random_splats(20, 1)
    splats = Splats(
        splats.means[:count],
        splats.opacities[:count],
        Sh(splats.colors.coefficients[:count], 1),
        quats=None if splats.quats is None else splats.quats[:count],
        scales=None if splats.scales is None else splats.scales[:count],
    )
    output = draw_and_check(rasterizer, splats, camera)
    assert output.color.shape == (1, height, width, 3)
    assert output.alpha.shape == (1, height, width, 1)
    if count == 20:
        assert output.alpha.max() > 0


def test_a_large_image_is_a_window_of_the_same_as_a_small_one(rasterizer):
    splats = random_splats(20, 1, dtype=torch.float64)
    small = front_camera(17, 31, dtype=torch.float64)
    large = replace(small, width=64, height=48)
    # Linearisation within the margin depends on the image's size; keep splats away from it.
    images = [rasterizer.render(splats, view).color for view in (small, large)]
    torch.testing.assert_close(images[0], images[1][:, :31, :17])


def test_an_image_that_nothing_touches_is_the_background(rasterizer):
    splats = random_splats(20, 1)
    away = replace(splats, means=splats.means + torch.tensor([1000.0, 0, 0]))
    background = torch.tensor([-0.5, 0.25, 2.0])
    settings = replace(EVERYTHING, background=background)
    output = draw_and_check(rasterizer, away, front_camera(), settings)
    assert torch.equal(output.color, background.expand_as(output.color))
    assert output.alpha.max() == 0
    assert output.depth is not None
    assert output.depth.abs().max() == 0


def test_many_layers_on_one_pixel_add_up(rasterizer):
    n = 20_000
    alpha = 1 / 254
    splats = Splats(
        means=torch.zeros(n, 3, dtype=torch.float64),
        opacities=torch.full((n,), alpha, dtype=torch.float64),
        colors=torch.ones(n, 1, dtype=torch.float64),
        quats=torch.ones(n, 4, dtype=torch.float64),
        scales=torch.ones(n, 3, dtype=torch.float64),
    )
    camera = front_camera(1, 1, dtype=torch.float64)
    output = draw_and_check(
        rasterizer, splats, camera, RenderSettings(statistics=frozenset(Statistic))
    )
    left = 1.0
    while left * (1 - alpha) > 1e-4:
        left *= 1 - alpha
    assert output.alpha.item() == pytest.approx(1 - left, abs=1e-12)
    opaque = replace(splats, opacities=torch.ones_like(splats.opacities))
    # (1 - 0.99) squared is within rounding of the stop: one is drawn, or two.
    drawn = draw_and_check(rasterizer, opaque, camera, RenderSettings()).alpha.item()
    assert min(abs(drawn - 0.99), abs(drawn - 0.9999)) < 1e-12


def test_one_opaque_splat_can_cover_everything(rasterizer):
    splats = scaled(1e6, 1e6, 1e6)(random_splats(1, 0))
    splats = replace(splats, opacities=torch.ones(1))
    output = draw_and_check(rasterizer, splats, front_camera(), RenderSettings())
    assert output.alpha.min().item() == pytest.approx(0.99)


def test_needles_lose_no_more_in_float32_than_their_projection_does(rasterizer):
    # Aspect 1e6 at 45 degrees: with the published determinant a c - b^2 the image is off by 0.4.
    quat = torch.tensor([[0.9238795325112867, 0.0, 0.0, 0.3826834323650898]], dtype=torch.float64)
    images = []
    for dtype in (torch.float32, torch.float64):
        splats = Splats(
            means=torch.zeros(1, 3, dtype=dtype),
            opacities=torch.ones(1, dtype=dtype),
            colors=torch.ones(1, 1, dtype=dtype),
            quats=quat.to(dtype),
            scales=torch.tensor([[1e3, 1e-3, 1e-3]], dtype=dtype),
        )
        color = rasterizer.render(splats, front_camera(64, 64, dtype=dtype)).color
        images.append(color.double())
    assert images[1].amax() > 0.9
    assert (images[0] - images[1]).abs().max() < 1e-5
