"""The gsplat rasterizer: what it declares, and what it refuses."""

import sys
from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import CameraModel
from gsfw.core.capabilities import Determinism, Feature, Needs
from gsfw.core.numerics import DEFAULT, GSPLAT_1_5
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.rasterizers.gsplat import package, rasterizer
from gsfw.rasterizers.gsplat.config import GsplatConfig
from gsfw.rasterizers.gsplat.rasterizer import GsplatRasterizer

SETTINGS = RenderSettings(profile=GSPLAT_1_5)


def test_it_declares_what_gsplat_does_without_importing_it(monkeypatch):
    monkeypatch.setattr(package, "version", lambda: "1.5.3")
    monkeypatch.setattr(package, "unavailable", str)
    monkeypatch.setitem(sys.modules, "gsplat", None)
    able = GsplatConfig().capabilities()
    assert able.determinism is Determinism.NONE
    assert able.details == {"gsplat": "1.5.3"}
    everything = Needs(frozenset(CameraModel), frozenset(Feature), 1000, profile="default")
    assert able.lacking(everything, "cuda") == [
        "feature 'float64'",
        "numerics 'default' (it renders only with 'gsplat-1.5')",
    ]
    assert able.lacking(Needs(profile="gsplat-1.5"), "cpu") == ["device 'cpu'"]
    assert 10 < able.preference < 20  # Between the cpu and the cuda rasterizer.
    monkeypatch.setattr(package, "version", lambda: "1.6.0")
    assert GsplatConfig().capabilities().profile == "default"


def test_where_it_is_not_installed_it_has_no_details(monkeypatch):
    monkeypatch.setattr(package, "version", str)
    able = GsplatConfig().capabilities()
    assert able.details == {}
    assert able.unavailable


def refused(adapter, splats, camera, settings=SETTINGS) -> str:
    with pytest.raises(ValueError, match=r":") as caught:
        adapter.render(splats, camera, settings)
    return str(caught.value)


def test_tensors_on_the_cpu_are_refused():
    built = GsplatConfig().build(torch.device("cuda"))
    assert refused(built, random_splats(5), front_camera()) == (
        "splats.means: expected a tensor on a GPU, found one on cpu"
    )


def test_float64_is_refused(adapter):
    splats, camera = random_splats(5, dtype=torch.float64), front_camera(dtype=torch.float64)
    assert refused(adapter, splats, camera) == (
        "splats.means: expected float32, which is all that gsplat renders, found torch.float64"
    )


def test_intrinsics_that_want_a_gradient_are_refused(adapter):
    camera = front_camera()
    camera = replace(camera, intrinsics=camera.intrinsics.requires_grad_())
    assert refused(adapter, random_splats(5), camera) == (
        "cameras.intrinsics: expected a tensor without gradient, because the gsplat rasterizer "
        "has none by intrinsics; use the reference rasterizer"
    )
    with torch.no_grad():
        adapter.render(random_splats(5), camera, SETTINGS)


def test_absgrad_over_more_channels_than_one_pass_is_refused(adapter):
    splats = replace(random_splats(5), colors=torch.rand(5, 32))
    asked = replace(SETTINGS, statistics=frozenset({Statistic.ABSGRAD}))
    adapter.render(splats, front_camera(), asked)
    deep = replace(asked, depth=Depth.EXPECTED)
    assert refused(adapter, splats, front_camera(), deep) == (
        "settings.statistics: gsplat measures absgrad over at most 32 channels, found 33; use "
        "another rasterizer"
    )
    adapter.render(splats, front_camera(), replace(SETTINGS, depth=Depth.EXPECTED))


@pytest.mark.parametrize("profile", [DEFAULT, GSPLAT_1_5.without_cutoffs()])
def test_constants_that_gsplat_does_not_draw_with_are_refused(adapter, profile):
    asked = RenderSettings(profile=profile)
    assert refused(adapter, random_splats(5), front_camera(), asked) == (
        "settings.profile: expected 'gsplat-1.5', because gsplat 1.5.3 renders with no other "
        f"constants, found {profile.name!r}; use profile=gsplat-1.5, or another rasterizer"
    )


def test_a_newer_gsplat_draws_with_the_default_constants(fake, monkeypatch):
    monkeypatch.setattr(rasterizer, "DEVICES", frozenset({"cpu"}))
    monkeypatch.setattr(package, "version", lambda: "1.6.0")
    adapter = GsplatRasterizer()
    adapter.render(random_splats(5), front_camera(), RenderSettings())
    assert "expected 'default'" in refused(adapter, random_splats(5), front_camera())
