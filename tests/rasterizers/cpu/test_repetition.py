"""The same bits, however often, with however many threads, and however many cameras at once."""

from dataclasses import replace

import pytest
import torch
from support.agreement import draw_everything
from support.random_scenes import Kind
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.kernels.cpu.native_module import NOT_BUILT, instruction_sets
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer

pytestmark = pytest.mark.skipif(not instruction_sets(), reason=NOT_BUILT)

DTYPES = pytest.mark.parametrize("dtype", [torch.float32, torch.float64])

EVERYTHING = RenderSettings(depth=Depth.EXPECTED, statistics=frozenset(Statistic), antialias=True)


def large_scene(dtype: torch.dtype) -> tuple[Splats, Cameras, RenderSettings]:
    """More rows than one task of any stage, deep enough for several chunks of a tile."""
    splats = random_splats(12_000, 2, dtype=dtype)
    assert splats.scales is not None
    splats = replace(splats, scales=0.3 * splats.scales, opacities=0.2 * splats.opacities)
    cameras = Cameras.cat([front_camera(70, 50, distance, dtype) for distance in (3.0, 2.0)])
    return splats, cameras, EVERYTHING


@pytest.fixture
def use_threads(monkeypatch):
    """Sets the number of threads, whatever this machine has."""

    def use(threads: int) -> None:
        monkeypatch.setattr("gsfw.rasterizers.cpu.rasterizer.num_threads", lambda: threads)

    return use


def assert_same_bits(found, expected) -> None:
    assert found.keys() == expected.keys()
    for name, tensor in expected.items():
        assert torch.equal(found[name], tensor), name


@DTYPES
def test_any_number_of_threads_gives_the_same_bits(use_threads, dtype):
    scene = large_scene(dtype)
    use_threads(1)
    expected = draw_everything(CpuRasterizer(), *scene)
    for threads in (2, 3, 7):
        use_threads(threads)
        assert_same_bits(draw_everything(CpuRasterizer(), *scene), expected)


@DTYPES
def test_repeating_gives_the_same_bits_after_other_images(dtype):
    scene = large_scene(dtype)
    other = Kind(5, (33, 9), CameraModel.FISHEYE, layout="channels", channels=16).scene(dtype)
    rasterizer = CpuRasterizer()
    expected = draw_everything(rasterizer, *scene)
    for _ in range(3):
        draw_everything(rasterizer, *other)  # Memory that it leaves behind must not matter.
        assert_same_bits(draw_everything(rasterizer, *scene), expected)


@DTYPES
def test_drawing_alone_gives_the_bits_of_drawing_with_gradients(dtype):
    splats, cameras, settings = large_scene(dtype)
    expected = draw_everything(CpuRasterizer(), splats, cameras, settings)
    alone = CpuRasterizer().render(splats, cameras, settings)
    assert not alone.color.requires_grad
    for name in ("color", "alpha", "depth"):
        assert torch.equal(getattr(alone, name), expected[name]), name
    assert torch.equal(alone.statistics.contribution, expected["contribution"])


@DTYPES
def test_a_batch_gives_the_bits_of_its_cameras(dtype):
    splats, cameras, settings = large_scene(dtype)
    together = draw_everything(CpuRasterizer(), splats, cameras, settings)
    for index in range(len(cameras)):
        one = draw_everything(CpuRasterizer(), splats, cameras.select([index]), settings)
        for name in ("color", "alpha", "depth", "radii", "visible", "contribution"):
            assert torch.equal(one[name][0], together[name][index]), name


def test_going_back_twice_gives_the_same_bits():
    splats, cameras, settings = large_scene(torch.float32)
    means = splats.means.clone().requires_grad_()
    output = CpuRasterizer().render(replace(splats, means=means), cameras, settings)
    loss = output.color.square().sum()
    (first,) = torch.autograd.grad(loss, means, retain_graph=True)
    statistic = output.statistics.screen_gradient.clone()
    (second,) = torch.autograd.grad(loss, means)
    assert torch.equal(first, second)
    assert torch.equal(output.statistics.screen_gradient, statistic)


def test_images_that_are_alive_together_do_not_disturb_one_another():
    scenes = [Kind(seed, (40, 30), CameraModel.PINHOLE).scene(torch.float32) for seed in range(4)]
    means = [splats.means.clone().requires_grad_() for splats, _, _ in scenes]

    def losses() -> list[torch.Tensor]:
        outputs = [
            CpuRasterizer().render(replace(splats, means=leaf), cameras, settings)
            for (splats, cameras, settings), leaf in zip(scenes, means, strict=True)
        ]
        return [output.color.square().sum() for output in outputs]

    together = [torch.autograd.grad(*pair)[0] for pair in zip(losses(), means, strict=True)][::-1]
    backwards = list(zip(losses(), means, strict=True))[::-1]
    for (loss, leaf), expected in zip(backwards, together, strict=True):
        assert torch.equal(torch.autograd.grad(loss, leaf)[0], expected)
