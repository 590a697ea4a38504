"""The ray rasterizer: its settings, what it cannot do, what it leaves out, and repetition."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats, turned_camera

from gsfw.core.cameras import CameraModel
from gsfw.core.capabilities import Capabilities, Determinism, Feature, Needs, check_fit, fitting
from gsfw.core.errors import ConfigError
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings, Statistic
from gsfw.core.splats import Sh
from gsfw.rasterizers import gsfw_rasterizers
from gsfw.rasterizers.ray.camera_rays import rays_of, tiles
from gsfw.rasterizers.ray.config import RayConfig
from gsfw.rasterizers.ray.gaussians import place, within_reach
from gsfw.rasterizers.ray.peak import Peak
from gsfw.rasterizers.ray.rasterizer import RayRasterizer
from gsfw.rasterizers.ray.volume import Volume
from gsfw.rasterizers.reference.config import ReferenceConfig

CPU = torch.device("cpu")


def test_it_is_registered_and_built_from_its_config():
    (spec,) = (spec for spec in gsfw_rasterizers() if spec.name == "ray")
    assert "Moenne-Loccoz" in spec.paper
    built = spec.load()(order="ray", dilation="none", chunk_mb=1.0).build(CPU)
    assert (built.mode, built.matched, built.chunk_mb) == (Peak("ray"), False, 1.0)
    assert RayConfig(mode="volume", samples=8).build(CPU).mode == Volume(8, None)
    random = RayConfig(mode="volume", sampling="stratified", sampling_seed=3)
    assert random.build(CPU).mode == Volume(64, 3)


def test_it_says_what_it_cannot_do_and_who_can():
    capabilities = {
        "ray": RayConfig().capabilities(),
        "reference": ReferenceConfig().capabilities(),
    }
    everything = Needs(frozenset(CameraModel), frozenset(Feature), channels=1000)
    assert capabilities["ray"].lacking(everything, "cpu") == [
        "feature 'absgrad'",
        "feature 'antialias'",
        "feature 'screen gradient'",
    ]
    needs = {"settings": RenderSettings(antialias=True).needs()}
    with pytest.raises(ConfigError) as caught:
        check_fit("ray", needs, capabilities, "cpu")
    assert "settings needs feature 'antialias'" in str(caught.value)
    assert "Rasterizers that fit here: reference." in caught.value.advice


def test_it_is_never_preferred():
    able = RayConfig().capabilities()
    assert able.determinism is Determinism.BITWISE
    others: dict[str, Capabilities] = {"reference": ReferenceConfig().capabilities(), "ray": able}
    assert fitting({}, others, "cpu") == ["reference", "ray"]


def test_what_it_cannot_do_is_refused_when_asked_for_directly():
    splats, camera = random_splats(2, 0), front_camera(4, 4)
    settings = RenderSettings(antialias=True, statistics=frozenset({Statistic.ABSGRAD}))
    with pytest.raises(ValueError, match="settings: the ray rasterizer has no absgrad and no anti"):
        RayRasterizer().render(splats, camera, settings)


@pytest.mark.parametrize("model", list(CameraModel))
def test_what_a_tile_leaves_out_is_not_seen_by_its_rays(model):
    splats = random_splats(150, 1, seed=2, dtype=torch.float64)
    camera = turned_camera(model).resized(40, 40)
    settings = RenderSettings()
    gaussians, rays = place(splats, camera, settings, matched=True), rays_of(camera)
    ratio = gaussians.opacities / settings.profile.alpha_min
    reaches = (2 * ratio.log()).sqrt() * gaussians.extents
    kept = []
    for tile in tiles(camera, CPU):
        some = rays.select(tile)
        met = within_reach(gaussians, some, reaches)
        channels = torch.ones(len(gaussians.rows), 1, dtype=torch.float64)
        offsets = torch.empty(len(tile), 0, dtype=torch.float64)
        touched = Peak().blend(some, offsets, gaussians, channels, DEFAULT).touched
        assert not touched[:, ~met].any()
        kept.append(met.float().mean().item())
    assert min(kept) < 0.5, "most of them are left out"


def test_evaluations_are_counted():
    splats = random_splats(10, 1)
    smooth = RenderSettings(profile=DEFAULT.without_cutoffs())
    for mode, each in ((Peak(), 1), (Volume(5), 5)):
        ray = RayRasterizer(mode)
        ray.render(splats, front_camera(20, 20), smooth)
        assert ray.evaluations == 400 * 10 * each


def test_ragged_coefficients_and_channels_are_drawn():
    dense = random_splats(6, 1, dtype=torch.float64)
    camera = turned_camera()
    degrees = torch.tensor([0, 1, 0, 1, 1, 0])
    ragged = dense.colors.of_degrees(degrees)
    cut = dense.colors.coefficients.clone()
    cut[degrees == 0, 1:] = 0
    images = [
        RayRasterizer().render(replace(dense, colors=colors), camera).color
        for colors in (ragged, Sh(cut, 1))
    ]
    assert torch.equal(images[0], images[1])
    flat = replace(dense, colors=dense.opacities[:, None].repeat(1, 7))
    assert RayRasterizer().render(flat, camera).color.shape == (1, 30, 40, 7)


@pytest.mark.parametrize("mode", [Peak("ray"), Volume(8, 0)], ids=["peak", "volume"])
def test_repeating_an_image_and_its_gradient_gives_the_same_bits(mode):
    splats, camera = random_splats(60, 1), front_camera()
    found = []
    for _ in range(2):
        means = splats.means.clone().requires_grad_()
        color = RayRasterizer(mode).render(replace(splats, means=means), camera).color
        color.square().sum().backward()
        found.append((color, means.grad))
    assert torch.equal(found[0][0], found[1][0])
    assert torch.equal(found[0][1], found[1][1])


def test_several_cameras_are_drawn_one_by_one():
    splats, camera = random_splats(20, 1), front_camera(20, 15)
    nearer = front_camera(20, 15, distance=3.0)
    both = type(camera).cat([camera, nearer])
    output = RayRasterizer().render(splats, both)
    for index, one in enumerate((camera, nearer)):
        alone = RayRasterizer().render(splats, one)
        assert torch.equal(output.color[index], alone.color[0])
        assert torch.equal(output.statistics.radii[index], alone.statistics.radii[0])
