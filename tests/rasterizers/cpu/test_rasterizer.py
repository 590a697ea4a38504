"""The cpu rasterizer: its limits, its capabilities, and when it is chosen."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import CameraModel
from gsfw.core.capabilities import Determinism, Feature, Needs
from gsfw.core.errors import ConfigError
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings
from gsfw.kernels.cpu import native_module
from gsfw.kernels.cpu.native_module import NOT_BUILT, instruction_sets
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve
from gsfw.rasterizers.cpu.config import CpuConfig
from gsfw.rasterizers.cpu.rasterizer import CpuBackend, CpuRasterizer
from gsfw.rasterizers.kernel_arguments import PairLimit

needs_native = pytest.mark.skipif(not instruction_sets(), reason=NOT_BUILT)


@needs_native
def test_more_pairs_than_allowed_are_refused_with_their_bytes():
    splats = random_splats(1000, 1)
    smooth = RenderSettings(profile=DEFAULT.without_cutoffs())  # Every splat meets every tile.
    with pytest.raises(ConfigError) as caught:
        CpuRasterizer(pairs_mb=0.1).render(splats, front_camera(40, 30), smooth)
    assert str(caught.value) == (
        "this image needs 324000 bytes for 6000 pairs of a splat and a tile that it reaches; "
        "rasterizer.pairs_mb=0.1 does not allow that.\n"
        "Render a smaller image, keep splats from growing this large, or raise the limit."
    )
    CpuRasterizer(pairs_mb=0.4).render(splats, front_camera(40, 30), smooth)


@needs_native
def test_more_pairs_than_can_be_numbered_are_refused_whatever_is_allowed():
    limit = PairLimit(1e9, 60, CpuBackend.max_pairs)
    assert limit.count == 2**32 - 1
    assert str(limit.refuse(2**33)).splitlines() == [
        "this image needs 515396075520 bytes for 8589934592 pairs of a splat and a tile that it "
        "reaches; rasterizer.pairs_mb=1e+09 does not allow that.",
        "No more than 4294967295 pairs can be numbered: render a smaller image.",
    ]


@needs_native
def test_intrinsics_that_want_a_gradient_are_refused():
    camera = front_camera()
    camera = replace(camera, intrinsics=camera.intrinsics.requires_grad_())
    with pytest.raises(ValueError, match="intrinsics") as caught:
        CpuRasterizer().render(random_splats(5), camera)
    assert str(caught.value) == (
        "cameras.intrinsics: expected a tensor without gradient, because the cpu rasterizer has "
        "none by intrinsics; use the reference rasterizer"
    )
    with torch.no_grad():
        CpuRasterizer().render(random_splats(5), camera)


@needs_native
def test_it_can_do_everything_with_the_same_bits_each_time():
    able = CpuConfig().capabilities()
    assert able.determinism is Determinism.BITWISE
    everything = Needs(frozenset(CameraModel), frozenset(Feature), channels=1000)
    assert able.lacking(everything, "cpu") == []
    assert able.lacking(Needs(), "cuda") == ["device 'cuda'"]
    assert instruction_sets()[-1] == "scalar"


def chosen() -> str:
    line = Layer(COMMAND_LINE, {"method": "3dgs", "device": "cpu"})
    return resolve(installed(), [line]).choices["rasterizer"].name


@needs_native
def test_it_is_chosen_on_the_cpu():
    assert chosen() == "cpu"


def test_where_it_is_not_built_the_reference_is_chosen(monkeypatch):
    monkeypatch.setattr("gsfw.rasterizers.cpu.rasterizer.instruction_sets", list)
    monkeypatch.setattr("gsfw.rasterizers.cpu.rasterizer.instruction_set", str)
    assert CpuConfig().capabilities().unavailable == native_module.NOT_BUILT
    assert chosen() == "reference"


@needs_native
def test_the_stages_are_timed():
    rasterizer = CpuRasterizer()
    splats = random_splats(200, 1).map(lambda tensor: tensor.requires_grad_())
    output = rasterizer.render(splats, front_camera())
    forward = rasterizer.stage_times()
    assert list(forward) == [
        "project",
        "sort",
        "bin",
        "blend",
        "blend_backward",
        "project_backward",
    ]
    assert min(forward[name].wall_ms for name in ("project", "sort", "bin", "blend")) > 0
    assert forward["blend_backward"].wall_ms == 0
    output.color.sum().backward()
    assert rasterizer.stage_times()["blend_backward"].wall_ms > 0
    assert rasterizer.stage_times()["project_backward"].cpu_ms > 0
