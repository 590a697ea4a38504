"""Random scenes agree with a renderer in plain Python loops."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from support.loops import draw_in_loops, turned_camera
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.numerics import DEFAULT, GSPLAT_1_5
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Sh, Splats

SETTINGS = RenderSettings(depth=Depth.ACCUMULATED, statistics=frozenset({Statistic.CONTRIBUTION}))


def draw(
    rasterizer: Rasterizer, splats: Splats, camera: Cameras, settings: RenderSettings
) -> np.ndarray:
    output = rasterizer.render(splats, camera, settings)
    parts = [output.color, output.extra, output.depth, output.alpha, 1 - output.alpha]
    return torch.cat([part for part in parts if part is not None], dim=3)[0].double().numpy()


@pytest.mark.parametrize("model", list(CameraModel))
@pytest.mark.parametrize("antialias", [False, True])
def test_the_image_is_the_one_that_loops_draw(rasterizer, model, antialias):
    splats = random_splats(25, 1, seed=3, dtype=torch.float64)
    splats = replace(splats, extra=torch.linspace(-1, 1, 50, dtype=torch.float64).view(25, 2))
    camera = turned_camera(model)
    settings = replace(SETTINGS, antialias=antialias)
    expected = draw_in_loops(splats, camera, antialias)
    assert expected[:, :, -2].max() > 0.3, "the scene must cover something"
    np.testing.assert_allclose(
        draw(rasterizer, splats, camera, settings), expected, rtol=0, atol=2e-8
    )


@pytest.mark.parametrize("profile", [GSPLAT_1_5, DEFAULT.without_cutoffs()])
def test_the_image_is_right_with_other_cut_offs(rasterizer, profile):
    splats = random_splats(25, 1, seed=4, dtype=torch.float64)
    splats = replace(splats, opacities=splats.opacities.sqrt().sqrt())
    camera = turned_camera(CameraModel.PINHOLE)
    expected = draw_in_loops(splats, camera, profile=profile)
    found = draw(rasterizer, splats, camera, replace(SETTINGS, profile=profile))
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-8)


def test_a_deep_scene_whose_pixels_stop_is_drawn_right(rasterizer):
    splats = random_splats(150, 1, seed=5, dtype=torch.float64)
    splats = replace(splats, opacities=splats.opacities.sqrt())
    camera = turned_camera(CameraModel.PINHOLE)
    expected = draw_in_loops(splats, camera)
    found = rasterizer.render(splats, camera).color[0]
    np.testing.assert_allclose(found, expected[:, :, :3], rtol=0, atol=2e-8)
    assert expected[:, :, -1].min() < 2e-4


def test_splats_close_to_the_camera_at_its_side_are_linearised_within_the_margin(rasterizer):
    splats = random_splats(12, 1, seed=6, dtype=torch.float64)
    means = splats.means * torch.tensor([6.0, 6.0, 0.2], dtype=torch.float64)
    splats = replace(splats, means=means, scales=3 * splats.scales)
    camera = front_camera(15, 12, distance=0.5, dtype=torch.float64)
    expected = draw_in_loops(splats, camera)
    np.testing.assert_allclose(
        draw(rasterizer, splats, camera, SETTINGS), expected, rtol=0, atol=2e-8
    )


def test_float32_stays_near_float64(rasterizer):
    splats = random_splats(200, 1, seed=7)
    doubles = random_splats(200, 1, seed=7, dtype=torch.float64)
    camera = front_camera(64, 48)
    wide = front_camera(64, 48, dtype=torch.float64)
    for settings, tolerance in [
        (RenderSettings(), 1e-3),
        (RenderSettings(profile=DEFAULT.without_cutoffs()), 1e-4),
    ]:
        images, gradients = [], []
        for scene, view in ((splats, camera), (doubles, wide)):
            tensors = scene.tensors()
            inputs = [t.clone().requires_grad_() for t in tensors.values()]
            named = dict(zip(tensors, inputs, strict=True))
            named["colors"] = Sh(named["colors"], 1)
            color = rasterizer.render(Splats(**named), view, settings).color
            color.square().sum().backward()
            images.append(color.detach().double())
            gradients.append([t.grad.double() for t in inputs if t.grad is not None])
        assert (images[0] - images[1]).norm() <= 1e-5 * images[1].norm()
        assert ((images[0] - images[1]).abs().amax(3) > 1e-5).double().mean() <= 5e-4
        for found, expected in zip(*gradients, strict=True):
            assert (found - expected).norm() <= tolerance * expected.norm()
