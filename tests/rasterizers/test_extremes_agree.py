"""The catalogue of extremes against the float64 reference: as near as the arithmetic allows."""

from dataclasses import replace

import pytest
import torch
from agreement import PICTURES, as_float64, distance, draw_everything
from extremes import CAMERAS, SPLATS
from scenes import front_camera, random_splats

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.numerics import DEFAULT
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

EVERYTHING = RenderSettings(
    antialias=True, depth=Depth.ACCUMULATED, statistics=frozenset(Statistic), near=1e-7
)

HOPELESS = 0.1
"""Where plain float32 is off by this much, float64 cannot be trusted to tell who is right."""


def check(backend: Rasterizer, splats: Splats, camera: Cameras, settings: RenderSettings) -> None:
    """How far plain float32 is from float64 tells how well a number is conditioned.

    Float32 may be off by three times as much, and float64, which has 29 bits more, by a millionth.
    """
    reference = ReferenceRasterizer()
    wide = as_float64(splats, camera, settings)
    expected = draw_everything(reference, *wide)
    plain = draw_everything(reference, splats, camera, settings)
    narrow_found = draw_everything(backend, splats, camera, settings)
    wide_found = draw_everything(backend, *wide)
    for name, tensor in expected.items():
        assert narrow_found[name].isfinite().all(), name
        assert wide_found[name].isfinite().all(), name
        conditioned = distance(plain[name], tensor, name)
        if not conditioned < HOPELESS:
            continue
        ordinary = 1e-4 if name in PICTURES else 1e-3
        off = distance(narrow_found[name], tensor, name)
        assert off <= max(ordinary, 3 * conditioned), name
        assert distance(wide_found[name], tensor, name) <= max(1e-12, 1e-6 * conditioned), name


@pytest.mark.parametrize("model", CameraModel)
@pytest.mark.parametrize("name", list(SPLATS))
def test_extreme_splats_agree(backend, name, model):
    splats = SPLATS[name](random_splats(20, 1))
    camera = replace(front_camera(20, 15), model=model)
    check(backend, splats, camera, EVERYTHING)
    if model is CameraModel.PINHOLE:
        smooth = replace(EVERYTHING, profile=DEFAULT.without_cutoffs())
        check(backend, splats, camera, smooth)


@pytest.mark.parametrize("model", CameraModel)
@pytest.mark.parametrize("name", list(CAMERAS))
def test_extreme_cameras_agree(backend, name, model):
    camera = CAMERAS[name](replace(front_camera(20, 15), model=model))
    check(backend, random_splats(20, 1), camera, EVERYTHING)


def test_a_wide_image_agrees(backend):
    # 1,024 columns of tiles: more than strips or blocks that are looked at together.
    splats = random_splats(20, 1)
    camera = front_camera(16384, 64)
    intrinsics = camera.intrinsics.clone()
    intrinsics[0, 0, 0], intrinsics[0, 1, 1] = 12000.0, 60.0
    check(backend, splats, replace(camera, intrinsics=intrinsics), replace(EVERYTHING, near=0.01))


def test_a_thousand_equal_depths_are_drawn_by_row(backend):
    n = 1000
    generator = torch.Generator().manual_seed(0)
    splats = Splats(
        means=torch.zeros(n, 3),
        opacities=0.02 * torch.rand(n, generator=generator),
        colors=torch.rand(n, 3, generator=generator),
        quats=torch.ones(n, 4),
        scales=0.3 * torch.ones(n, 3),
    )
    check(backend, splats, front_camera(20, 15), EVERYTHING)
    backwards = splats.map(lambda tensor: tensor.flip(0))
    forth, back = (backend.render(s, front_camera(20, 15)).color for s in (splats, backwards))
    assert (forth - back).abs().max() > 1e-3, "the order of rows must show"


@pytest.mark.parametrize("opacity", [1 / 254, 0.99])
def test_100000_layers_on_one_pixel_agree(backend, opacity):
    n = 100_000
    splats = Splats(
        means=torch.zeros(n, 3),
        opacities=torch.full((n,), opacity),
        colors=torch.linspace(0, 1, n)[:, None],
        quats=torch.ones(n, 4),
        scales=torch.ones(n, 3),
    )
    camera = front_camera(1, 1)
    wide = as_float64(splats, camera, RenderSettings())
    expected = ReferenceRasterizer().render(*wide)
    found = backend.render(splats, camera)
    assert (found.alpha - expected.alpha).abs().max() < (1e-2 if opacity > 0.5 else 1e-4)
    assert (found.color - expected.color).abs().max() < 1e-4
