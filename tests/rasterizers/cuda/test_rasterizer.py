"""The cuda rasterizer: its limits, its bits, and what it waits for."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
import torch
from emulation.launcher import EmulatedLauncher
from support.agreement import as_float64, check_float32, check_float64, draw_everything
from support.native_programs import compiler
from support.sampling import sampled
from support.scenes import front_camera, random_splats
from torch.utils._python_dispatch import TorchDispatchMode

from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Determinism, Feature, Needs
from gsfw.core.errors import ConfigError
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import Depth, RenderSettings, Statistic, Validation
from gsfw.core.splats import Splats
from gsfw.kernels.cuda.instances import CHUNKS, instances
from gsfw.rasterizers.cuda.config import CudaConfig
from gsfw.rasterizers.cuda.rasterizer import CudaRasterizer
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

EVERYTHING = RenderSettings(depth=Depth.EXPECTED, statistics=frozenset(Statistic), antialias=True)

FORWARD = ("color", "alpha", "depth", "radii", "visible")


def emulated(seed: int = 0, deterministic: bool = False, pairs_mb: float = 4096.0):
    compiler()
    return CudaRasterizer(EmulatedLauncher(seed=seed), pairs_mb, deterministic)


def deep_scene() -> tuple[Splats, Cameras, RenderSettings]:
    """Deep enough for several chunks of a tile, seen by two cameras."""
    splats = random_splats(3000, 1)
    splats = replace(splats, opacities=0.1 * splats.opacities)
    cameras = Cameras.cat([front_camera(40, 30, distance) for distance in (3.0, 2.0)])
    return splats, cameras, EVERYTHING


@pytest.mark.slow
def test_when_deterministic_any_order_of_threads_gives_the_same_bits():
    scene = deep_scene()
    expected = draw_everything(emulated(0, deterministic=True), *scene)
    for seed in (1, 2):
        found = draw_everything(emulated(seed, deterministic=True), *scene)
        for name, tensor in expected.items():
            assert torch.equal(found[name], tensor), name


@pytest.mark.slow
def test_images_have_the_same_bits_even_when_gradients_have_not():
    scene = deep_scene()
    expected = draw_everything(emulated(0, deterministic=True), *scene)
    found = draw_everything(emulated(1), *scene)
    assert all(torch.equal(found[name], expected[name]) for name in FORWARD)
    assert not all(torch.equal(found[name], tensor) for name, tensor in expected.items())
    for name, tensor in expected.items():
        torch.testing.assert_close(found[name], tensor, rtol=1e-3, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "dtype", [torch.float32, pytest.param(torch.float64, marks=pytest.mark.slow)]
)
def test_the_deterministic_mode_agrees_with_the_reference(dtype):
    splats, cameras, settings = deep_scene()
    wide = as_float64(splats, cameras, settings)
    expected = draw_everything(ReferenceRasterizer(), *wide)
    if dtype == torch.float64:
        check_float64(draw_everything(emulated(1, deterministic=True), *wide), expected)
    else:
        found = draw_everything(emulated(1, deterministic=True), splats, cameras, settings)
        check_float32(found, expected, settings.profile)


@pytest.fixture
def fresh_instances() -> Iterator[None]:
    """Instances know the chunks that they were made with."""
    instances.cache_clear()
    yield
    instances.cache_clear()


@pytest.mark.slow
@pytest.mark.usefixtures("fresh_instances")
@pytest.mark.parametrize("chunk", sampled([((64, 32),), ((64, 64),), ((128, 32),)], [2]))
def test_other_chunks_give_the_same_image_and_the_same_gradient(chunk, monkeypatch):
    scene = deep_scene()
    usual = draw_everything(emulated(), *scene)
    monkeypatch.setitem(CHUNKS, torch.float32, {8: chunk})
    instances.cache_clear()
    found = draw_everything(emulated(1, deterministic=True), *scene)
    assert all(torch.equal(found[name], usual[name]) for name in FORWARD)
    check_float32(found, draw_everything(ReferenceRasterizer(), *as_float64(*scene)), DEFAULT)


class _Reads(TorchDispatchMode):
    """Counts how often the host reads a number, for which it would wait for a device."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        waiting = ("_local_scalar_dense", "nonzero", "masked_select", "equal", "is_nonzero")
        self.count += any(function.__name__.startswith(name) for name in waiting)
        return function(*args, **(kwargs or {}))


@pytest.mark.parametrize("deterministic", [False, True])
def test_the_host_reads_one_number_per_image(deterministic):
    rasterizer = emulated(deterministic=deterministic)
    splats = random_splats(50, 1).map(lambda tensor: tensor.requires_grad_())
    settings = replace(EVERYTHING, validation=Validation.CHEAP)
    rasterizer.render(splats, front_camera(), settings)  # Some numbers are worked out only once.
    with _Reads() as reads:
        rasterizer.render(splats, front_camera(), settings).color.sum().backward()
    assert reads.count == 1


def test_more_pairs_than_allowed_are_refused_with_their_bytes():
    splats = random_splats(1000, 1)
    smooth = RenderSettings(profile=DEFAULT.without_cutoffs())  # Every splat meets every tile.
    with pytest.raises(ConfigError) as caught:
        emulated(pairs_mb=0.1).render(splats, front_camera(40, 30), smooth)
    assert str(caught.value) == (
        "this image needs 336000 bytes for 6000 pairs of a splat and a tile that it reaches; "
        "rasterizer.pairs_mb=0.1 does not allow that.\n"
        "Render a smaller image, keep splats from growing this large, or raise the limit."
    )
    emulated(pairs_mb=0.4).render(splats, front_camera(40, 30), smooth)


def test_more_channels_than_are_drawn_at_once_are_refused():
    splats = replace(random_splats(5), colors=torch.rand(5, 32), extra=torch.rand(5, 9))
    with pytest.raises(ValueError, match="channels") as caught:
        emulated().render(splats, front_camera())
    assert str(caught.value) == (
        "splats: expected at most 40 channels with those of extra and depth, found 41; render "
        "them in several passes"
    )


def test_it_says_what_it_can_do():
    able = CudaConfig().capabilities()
    assert able.devices == {"cuda"}
    assert able.determinism is Determinism.NONE
    assert CudaConfig(deterministic=True).capabilities().determinism is Determinism.BITWISE
    everything = Needs(features=frozenset(Feature), channels=1000, extra_channels=10)
    assert replace(able, unavailable="").lacking(everything, "cuda") == [
        "1012 channels (10 extra, 2 for depth), of which it renders at most 40 at once",
    ]


def test_drawing_without_gradient_keeps_nothing_for_the_way_back():
    splats = random_splats(20, 1)
    expected = emulated().render(splats.map(lambda t: t.requires_grad_()), front_camera()).color
    with torch.no_grad():
        assert torch.equal(emulated().render(splats, front_camera()).color, expected)


class _Elsewhere(EmulatedLauncher):
    def reaches(self, device: torch.device) -> bool:
        return False


def test_tensors_on_another_device_are_refused():
    rasterizer = CudaRasterizer(_Elsewhere())
    with pytest.raises(ValueError, match="GPU") as caught:
        rasterizer.render(random_splats(5), front_camera())
    assert str(caught.value) == (
        "splats.means: expected a tensor on the GPU that the rasterizer was built for, found one "
        "on cpu"
    )
