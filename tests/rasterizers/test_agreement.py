"""Every backend against the float64 reference, on 200 random scenes and on chosen ones."""

from dataclasses import replace
from functools import lru_cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, Phase, example, given, settings
from support.agreement import (
    FUSED,
    Drawn,
    as_float64,
    check_float32,
    check_float64,
    draw_everything,
)
from support.backends import CUDA, EMULATED, emulated_sample
from support.random_scenes import CHANNELS, SIZES, Kind, kinds
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.stress.judgement import faults_of_float32

SCENES = settings(
    max_examples=50,
    derandomize=True,
    database=None,
    phases=[Phase.generate],
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)

"""Of four tests: 200 together. The backend, which is the fixture, has no state that matters."""

OFTEN = pytest.mark.parametrize(
    "backend",
    [
        "cpu",
        pytest.param(EMULATED, marks=pytest.mark.slow),
        *(pytest.param(name, marks=pytest.mark.cuda) for name in CUDA),
    ],
    indirect=True,
)
"""The emulation takes chosen scenes every day, and random ones where time is no matter."""

# What is drawn here is drawn with checks by the tests of its parts.
pytestmark = pytest.mark.unchecked


@lru_cache(maxsize=500)
def drawn_by_the_reference(kind: Kind) -> Drawn:
    """What is expected of a scene; every backend is asked for the same ones."""
    return draw_everything(ReferenceRasterizer(), *as_float64(*kind.scene(torch.float32)))


def check(backend: Rasterizer, kind: Kind) -> None:
    """Draw one scene in both types; the reference gets exactly the same numbers."""
    narrow = kind.scene(torch.float32)
    wide = as_float64(*narrow)
    expected = drawn_by_the_reference(kind)
    bounds = {} if isinstance(backend, CpuRasterizer) else FUSED
    check_float64(draw_everything(backend, *wide), expected, bounds)
    if kind.cut_offs or kind.depth is not Depth.EXPECTED:
        # Without them depth is divided by weights of 1e-30, whose ratios float32 does not know.
        found = draw_everything(backend, *narrow)
        if faults_of_float32(found, expected, narrow[2].profile):
            # Some drawn scenes are ill-conditioned, such as those of needles given by covariances.
            plain = draw_everything(ReferenceRasterizer(), *narrow)
            assert not faults_of_float32(found, expected, narrow[2].profile, plain)


@OFTEN
@SCENES
@given(kinds(model=CameraModel.PINHOLE, cut_offs=True))
def test_random_scenes_agree(backend, kind):
    check(backend, kind)


NEEDLES = Kind(
    seed=122244,
    size=(17, 31),
    model=CameraModel.PINHOLE,
    count=26,
    cameras=2,
    degree=4,
    layout="ragged",
    extras=1,
    covariances=True,
    background="constant",
    antialias=True,
    depth=Depth.ACCUMULATED,
    cut_offs=False,
)
"""Plain float32 is off by 4e-4 in the gradients of its covariances."""


@pytest.mark.slow
@OFTEN
@SCENES
@example(NEEDLES)
@given(kinds(model=CameraModel.PINHOLE, cut_offs=False))
def test_random_scenes_without_cut_offs_agree(backend, kind):
    check(backend, kind)


@pytest.mark.slow
@OFTEN
@SCENES
@given(kinds(model=CameraModel.ORTHOGRAPHIC))
def test_random_orthographic_scenes_agree(backend, kind):
    check(backend, kind)


@pytest.mark.slow
@OFTEN
@SCENES
@given(kinds(model=CameraModel.FISHEYE))
def test_random_fisheye_scenes_agree(backend, kind):
    check(backend, kind)


LAYOUTS = ("together", "two parts", "ragged", "half active")


@pytest.mark.parametrize(
    ("backend", "degree", "layout"),
    emulated_sample(list(product(range(5), LAYOUTS)), daily=range(2, 20, 5)),
    indirect=["backend"],
)
def test_every_layout_and_degree_of_colours_agrees(backend, degree, layout):
    check(backend, Kind(1, (33, 9), CameraModel.PINHOLE, cameras=2, degree=degree, layout=layout))


@pytest.mark.parametrize(
    ("backend", "channels", "extras"),
    emulated_sample(list(product(CHANNELS, (0, 3))), daily=[3, 10]),
    indirect=["backend"],
)
def test_every_number_of_channels_agrees(backend, channels, extras):
    for depth in Depth:
        kind = Kind(2, (33, 9), CameraModel.PINHOLE, layout="channels", channels=channels)
        check(backend, replace(kind, extras=extras, depth=depth, background="constant"))


SIZES_AND_MODELS = list(product(SIZES, CameraModel))


@pytest.mark.parametrize(
    ("backend", "size", "model"),
    emulated_sample(SIZES_AND_MODELS, daily=range(0, len(SIZES_AND_MODELS), len(CameraModel) + 1)),
    indirect=["backend"],
)
def test_every_size_and_camera_model_agrees(backend, model, size):
    for covariances in (False, True):
        kind = Kind(3, size, model, cameras=2, covariances=covariances, antialias=covariances)
        check(backend, replace(kind, background="differentiated", depth=Depth.ACCUMULATED))


def workload(shared_data: Path, dtype: torch.dtype) -> tuple[Splats, Cameras, RenderSettings]:
    stored = np.load(shared_data / "reference" / "garden_workload.npz")
    named = {name: torch.from_numpy(np.asarray(stored[name])).to(dtype) for name in stored}
    shape = ("means", "opacities", "colors", "quats", "scales")
    poses = named["world_to_camera"][None], named["intrinsics"][None]
    settings = RenderSettings(statistics=frozenset(Statistic))
    return Splats(*(named[name] for name in shape)), Cameras(*poses, 648, 420), settings


@pytest.fixture(scope="module")
def garden() -> dict[str, Tensor]:
    """The garden workload as the reference draws it, filled by the first test that asks."""
    return {}


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_garden_workload_is_within_the_stated_tolerances(
    rasterizer, shared_data, garden, dtype
):
    if not garden:
        wide = workload(shared_data, torch.float64)
        garden.update(draw_everything(ReferenceRasterizer(), *wide))
    if dtype == torch.float64 and isinstance(rasterizer, ReferenceRasterizer):
        return  # It is what the others are measured against.
    scene = workload(shared_data, dtype)
    drawn = draw_everything(rasterizer, *scene)
    if dtype == torch.float64:
        check_float64(drawn, garden)
    else:
        check_float32(drawn, garden, scene[2].profile)
