"""The real gsplat, on a GPU, against the reference with the constants that gsplat draws with."""

from dataclasses import replace

import pytest
import torch
from support.agreement import IMAGES, STATISTICS, as_float64, distance, draw_everything
from support.on_cuda import OnCuda
from support.random_scenes import Kind

from gsfw.core.cameras import CameraModel
from gsfw.core.maths.spherical_harmonics import degree_of
from gsfw.core.numerics import PROFILES
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.rasterizers.gsplat import package
from gsfw.rasterizers.gsplat.config import GsplatConfig
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

pytestmark = [
    pytest.mark.cuda,
    pytest.mark.slow,  # The first call may compile.
    pytest.mark.skipif(bool(package.unavailable()), reason=package.unavailable() or "none"),
    # The package's own warnings are none of ours.
    pytest.mark.filterwarnings("ignore"),
]

GRADIENTS = frozenset({Statistic.SCREEN_GRADIENT, Statistic.ABSGRAD})

IMAGE_TOLERANCE = 1e-3
GRADIENT_TOLERANCE = 2e-2
"""Relative, in L2. gsplat is compiled with fast maths, and divides by 1 - alpha on the way back."""

FACES = CameraModel.PINHOLE
KINDS = {
    "plain": Kind(1, (64, 64), FACES, count=60),
    "other colours": Kind(2, (33, 9), FACES, layout="channels", channels=5, extras=2),
    "many channels": Kind(3, (17, 31), FACES, layout="channels", channels=16),
    "harmonics and more": Kind(4, (64, 64), FACES, layout="two parts", extras=3, cameras=2),
    "ragged": Kind(5, (64, 64), FACES, layout="ragged", cameras=3),
    "degree 4": Kind(6, (64, 64), FACES, degree=4),
    "background": Kind(7, (64, 64), FACES, background="differentiated"),
    "depth": Kind(8, (64, 64), FACES, depth=Depth.ACCUMULATED, background="constant"),
    "expected depth": Kind(9, (64, 64), FACES, depth=Depth.EXPECTED, extras=1),
    "antialias": Kind(10, (64, 64), FACES, antialias=True),
    "covariances": Kind(11, (64, 64), FACES, covariances=True),
    "orthographic": Kind(12, (64, 64), CameraModel.ORTHOGRAPHIC),
    "fisheye": Kind(13, (64, 64), CameraModel.FISHEYE),
}


@pytest.fixture(scope="module")
def real() -> OnCuda:
    return OnCuda(GsplatConfig().build(torch.device("cuda")))


def profiled(settings: RenderSettings) -> RenderSettings:
    profile = PROFILES[GsplatConfig().capabilities().profile]
    return replace(settings, profile=profile, statistics=GRADIENTS)


@pytest.mark.parametrize("name", KINDS)
def test_the_real_one_agrees(real, name):
    splats, cameras, settings = KINDS[name].scene(torch.float32)
    settings = profiled(settings)
    found = draw_everything(real, splats, cameras, settings)
    expected = draw_everything(ReferenceRasterizer(), *as_float64(splats, cameras, settings))
    assert found.keys() == expected.keys()
    for part, tensor in expected.items():
        if part in ("visible", "radii"):
            continue
        if part == "gradient of world_to_camera":
            # They agree where a camera can go: gsplat inverts the matrix, we transpose it.
            ours, theirs = (
                along_poses(g[part], cameras.world_to_camera) for g in (expected, found)
            )
            assert distance(theirs, ours, part) <= GRADIENT_TOLERANCE, part
            continue
        tolerance = IMAGE_TOLERANCE if part in IMAGES else GRADIENT_TOLERANCE
        assert found[part].isfinite().all(), part
        assert distance(found[part], tensor, part) <= tolerance, part
    # gsplat rounds radii up, by which a splat may just reach the image.
    seen = expected["visible"]
    assert found["visible"][seen].all()
    assert (found["radii"][seen] >= expected["radii"][seen] - 1e-3).all()
    assert (found["radii"][seen] <= expected["radii"][seen] + 1.001).all()
    assert {"screen_gradient", "absgrad"} <= {*STATISTICS} & found.keys()


def along_poses(gradient: torch.Tensor, poses: torch.Tensor) -> torch.Tensor:
    """A gradient by [c, 4, 4] as one by small turns and shifts of the camera."""
    gradient, poses = gradient.double(), poses.double()
    turned = gradient[:, :3] @ poses[:, :3].transpose(1, 2)
    return torch.cat([turned - turned.transpose(1, 2), gradient[:, :3, 3:]], dim=2)


@pytest.mark.parametrize("depth", Depth)
def test_no_splats_and_none_in_sight_are_drawn(real, depth):
    splats, cameras, settings = KINDS["plain"].scene(torch.float32)
    settings = profiled(replace(settings, depth=depth, background=torch.rand(3)))
    behind = replace(splats, means=splats.means - torch.tensor([0.0, 0.0, 1e3]))
    for scene in (splats.map(lambda tensor: tensor[:0]), behind):
        assert isinstance(scene, Splats)
        assert degree_of(scene.colors.coefficients.shape[1]) == 3
        found = draw_everything(real, scene, cameras, settings)
        assert settings.background is not None
        assert torch.equal(found["color"][0, 3, 4], settings.background)
        assert found["alpha"].abs().max() == 0
        assert all(tensor.isfinite().all() for tensor in found.values())


def test_drawing_again_does_not_take_more_memory(real):
    splats, cameras, settings = KINDS["plain"].scene(torch.float32)
    used = []
    for _ in range(3):
        draw_everything(real, splats, cameras, profiled(settings))
        used.append(torch.cuda.memory_allocated())
    assert used[1] == used[2]
