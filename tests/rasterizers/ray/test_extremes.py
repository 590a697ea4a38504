"""The catalogue of extremes, along rays: whatever passes validation is drawn, and finite."""

from dataclasses import replace

import pytest
import torch
from support.finite_drawings import draw_and_check
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import CameraModel
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.rasterizers.ray.peak import Peak
from gsfw.rasterizers.ray.rasterizer import RayRasterizer
from gsfw.rasterizers.ray.volume import Volume
from gsfw.studies.stress.catalogue import CHANGES
from gsfw.studies.stress.catalogue.views import CAMERAS

MODES = {
    "mean": RayRasterizer(Peak("mean")),
    "ray, no dilation": RayRasterizer(Peak("ray"), matched=False),
    "volume": RayRasterizer(Volume(4)),
    "volume, no dilation": RayRasterizer(Volume(4, seed=1), matched=False),
}
SETTINGS = RenderSettings(
    depth=Depth.EXPECTED, statistics=frozenset({Statistic.CONTRIBUTION}), near=1e-7
)

# What is drawn here is drawn with checks by the tests of its parts.
pytestmark = [pytest.mark.unchecked, pytest.mark.slow]
CASES = [(mode, torch.float32) for mode in MODES]
CASES += [("mean", torch.float64), ("volume, no dilation", torch.float64)]


@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.parametrize(("mode", "dtype"), CASES)
def test_extreme_splats_stay_finite(mode, dtype, name):
    splats = CHANGES[name](random_splats(20, 1, dtype=dtype))
    smooth = replace(SETTINGS, profile=DEFAULT.without_cutoffs())
    open_ended = replace(SETTINGS, near=0.0, far=torch.inf)
    by_model = {
        CameraModel.PINHOLE: SETTINGS,
        CameraModel.ORTHOGRAPHIC: open_ended,
        CameraModel.FISHEYE: smooth,
    }
    for model, settings in by_model.items():
        camera = replace(front_camera(12, 9, dtype=dtype), model=model)
        draw_and_check(MODES[mode], splats, camera, settings)


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize(("mode", "dtype"), CASES)
def test_extreme_cameras_stay_finite(mode, dtype, name):
    for model in CameraModel:
        camera = CAMERAS[name](replace(front_camera(12, 9, dtype=dtype), model=model))
        for change in ("shape/scales-1e6", "depth/around-the-camera"):
            splats = CHANGES[change](random_splats(20, 1, dtype=dtype))
            draw_and_check(MODES[mode], splats, camera, SETTINGS)


@pytest.mark.parametrize("mode", list(MODES))
@pytest.mark.parametrize("count", [0, 1, 20])
@pytest.mark.parametrize("size", [(1, 1), (1, 400), (400, 1), (17, 31)])
def test_every_image_size_is_drawn(mode, count, size):
    splats = random_splats(20, 1)
    splats = replace(splats.map(lambda tensor: tensor[:count]), opacities=torch.full((count,), 0.9))
    camera = front_camera(*size, distance=1.5)
    output = draw_and_check(MODES[mode], splats, camera, SETTINGS)
    assert output.color.shape == (1, size[1], size[0], 3)
    if count == 20:
        assert output.alpha.max() > 0
    if count == 0:
        assert output.alpha.abs().max() == 0


def test_a_disc_seen_from_its_edge_is_not_there_until_it_has_the_thickness_of_a_pixel():
    quat = torch.tensor([[1.0, 0.0, 0.0, 0.0]], dtype=torch.float64)
    splats = replace(
        random_splats(1, 0, dtype=torch.float64),
        means=torch.zeros(1, 3, dtype=torch.float64),
        quats=quat,
        scales=torch.tensor([[0.0, 0.5, 0.5]], dtype=torch.float64),
        opacities=torch.ones(1, dtype=torch.float64),
    )
    camera = front_camera(41, 31, dtype=torch.float64)
    bare = draw_and_check(MODES["ray, no dilation"], splats, camera, SETTINGS)
    assert bare.alpha.max() == 0, "the disc's plane is the middle column's, whose rays lie in it"
    grown = draw_and_check(MODES["mean"], splats, camera, SETTINGS)
    assert grown.alpha.max().item() == pytest.approx(0.99)
    assert grown.statistics.radii.item() > 5


@pytest.mark.parametrize("mode", list(MODES))
def test_needles_lose_little_in_float32(mode):
    images = []
    for dtype in (torch.float32, torch.float64):
        splats = replace(
            random_splats(1, 0, dtype=dtype),
            means=torch.zeros(1, 3, dtype=dtype),
            opacities=torch.ones(1, dtype=dtype),
            quats=torch.tensor([[0.9238795325112867, 0.0, 0.0, 0.3826834323650898]], dtype=dtype),
            scales=torch.tensor([[1e3, 1e-3, 1e-3]], dtype=dtype),
            colors=torch.ones(1, 1, dtype=dtype),
        )
        camera = front_camera(64, 64, dtype=dtype)
        images.append(MODES[mode].render(splats, camera).color.double())
    assert images[1].amax() > 0.9
    assert (images[0] - images[1]).abs().max() < 2e-3
