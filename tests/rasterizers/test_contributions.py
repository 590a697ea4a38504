"""Sums of blending weights per splat, each pixel times a given weight."""

from dataclasses import replace

import pytest
import torch
from support.loops import draw_in_loops, turned_camera
from support.scenes import front_camera, random_splats
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.capabilities import Feature
from gsfw.core.numerics import DEFAULT, GSPLAT_1_5
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import Depth, RenderSettings, Statistic, Validation
from gsfw.core.splats import Splats
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer
from gsfw.rasterizers.ray.rasterizer import RayRasterizer
from gsfw.rasterizers.ray.volume import Volume
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

MEASURED = RenderSettings(statistics=frozenset({Statistic.CONTRIBUTION}))
SIZES = [(1, 1), (16, 16), (17, 16), (33, 9), (8, 40)]


def signed_weights(cameras: Cameras) -> Tensor:
    """Random weights for every pixel, of which about half are negative and some are zero."""
    generator = torch.Generator().manual_seed(9)
    shape = (len(cameras), cameras.height, cameras.width, 1)
    weights = torch.randn(shape, generator=generator, dtype=torch.float64)
    return torch.where(weights.abs() < 0.2, 0.0, weights).to(cameras.intrinsics.dtype)


def two_cameras(width: int, height: int, dtype: torch.dtype = torch.float64) -> Cameras:
    return Cameras.cat([front_camera(width, height, distance, dtype) for distance in (4.0, 2.5)])


def scene(count: int = 60, dtype: torch.dtype = torch.float64) -> Splats:
    """Every third splat lies behind the cameras."""
    splats = random_splats(count, 1, dtype=dtype)
    means = splats.means.clone()
    means[::3, 2] = -100
    return replace(splats, means=means)


def weights_of_splats(rasterizer: Rasterizer, splats: Splats, cameras: Cameras) -> Tensor:
    """[c, h, w, n]: blending weights, rendered as one extra channel per splat."""
    eye = torch.eye(len(splats), dtype=splats.means.dtype)
    images = []
    for channels in eye.split(30, dim=1):
        extra = rasterizer.render(replace(splats, extra=channels), cameras).extra
        assert extra is not None
        images.append(extra)
    return torch.cat(images, dim=3)


@pytest.mark.parametrize("antialias", [False, True])
@pytest.mark.parametrize("model", list(CameraModel))
def test_contributions_are_the_sums_that_loops_find(rasterizer, model, antialias):
    splats = random_splats(25, 1, seed=3, dtype=torch.float64)
    camera = turned_camera(model)
    traced = replace(splats, extra=torch.eye(25, dtype=torch.float64))
    of_splats = torch.from_numpy(draw_in_loops(traced, camera, antialias)[:, :, 3:28])
    weights = signed_weights(camera)
    expected = (of_splats * weights[0]).sum((0, 1))
    found = rasterizer.contributions(splats, camera, weights, RenderSettings(antialias=antialias))
    assert expected.abs().max() > 0.3, "the scene must cover something"
    torch.testing.assert_close(found[0], expected, rtol=0, atol=2e-7)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_every_backend_agrees_with_the_reference_at_any_size(backend, size, dtype):
    splats, cameras = scene(200, dtype), two_cameras(*size, dtype=dtype)
    weights = signed_weights(cameras)
    wide = splats.map(Tensor.double)
    expected = ReferenceRasterizer().contributions(
        wide, cameras.to(dtype=torch.float64), weights.double()
    )
    found = backend.contributions(splats, cameras, weights)
    tolerance = 1e-10 if dtype == torch.float64 else 2e-4
    torch.testing.assert_close(found.double(), expected, rtol=tolerance, atol=tolerance)
    assert found.dtype == dtype
    assert (found[:, ::3] == 0).all(), "splats behind the cameras contribute nothing"


@pytest.mark.parametrize("mode", [None, Volume(16)])
def test_rays_weigh_what_they_blend(mode):
    rasterizer = RayRasterizer(mode)
    splats, cameras = scene(30), two_cameras(17, 9)
    weights = signed_weights(cameras)
    expected = (weights_of_splats(rasterizer, splats, cameras) * weights).sum((1, 2))
    found = rasterizer.contributions(splats, cameras, weights)
    torch.testing.assert_close(found, expected, rtol=1e-10, atol=1e-10)


def test_a_deep_scene_whose_pixels_stop_is_summed_right(rasterizer):
    splats = random_splats(400, 1, seed=5, dtype=torch.float64)
    splats = replace(splats, opacities=splats.opacities.sqrt())
    cameras = two_cameras(21, 18)
    weights = signed_weights(cameras)
    expected = (weights_of_splats(rasterizer, splats, cameras) * weights).sum((1, 2))
    found = rasterizer.contributions(splats, cameras, weights)
    torch.testing.assert_close(found, expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_ones_give_the_contribution_without_weights_to_the_bit(rasterizer, dtype):
    splats, cameras = scene(200, dtype), two_cameras(33, 20, dtype)
    rendered = rasterizer.render(splats, cameras, MEASURED).statistics.contribution
    ones = torch.ones(2, 20, 33, 1, dtype=dtype)
    assert torch.equal(rasterizer.contributions(splats, cameras), rendered)
    assert torch.equal(rasterizer.contributions(splats, cameras, ones), rendered)


def test_weights_in_the_settings_are_summed_while_rendering(rasterizer):
    splats, cameras = scene(), two_cameras(20, 12)
    weights = signed_weights(cameras)
    settings = replace(MEASURED, contribution_weights=weights, depth=Depth.EXPECTED)
    output = rasterizer.render(splats, cameras, settings)
    torch.testing.assert_close(output.color, rasterizer.render(splats, cameras).color)
    found = rasterizer.contributions(splats, cameras, weights)
    assert output.statistics.contribution is not None
    torch.testing.assert_close(output.statistics.contribution, found, rtol=1e-12, atol=1e-12)


def test_zero_weights_give_zero_and_a_mask_selects_its_pixels(rasterizer):
    splats, cameras = scene(), two_cameras(20, 12)
    mask = torch.zeros(2, 12, 20, 1, dtype=torch.float64)
    assert (rasterizer.contributions(splats, cameras, mask) == 0).all()
    mask[1, 3:9, 5:14] = 1
    found = rasterizer.contributions(splats, cameras, mask)
    everywhere = rasterizer.contributions(splats, cameras)
    assert (found[0] == 0).all()
    assert (found[1] <= everywhere[1] + 1e-12).all()
    assert 0 < found[1].sum() < everywhere[1].sum()


def test_the_weighted_sum_is_the_gradient_of_a_channel(rasterizer):
    """The image is linear in its channels."""
    splats, cameras = scene(), two_cameras(20, 12)
    weights = signed_weights(cameras)
    channel = torch.ones(len(splats), 1, dtype=torch.float64, requires_grad=True)
    image = rasterizer.render(replace(splats, extra=channel), cameras).extra
    (expected,) = torch.autograd.grad((image * weights).sum(), channel)
    found = rasterizer.contributions(splats, cameras, weights)
    torch.testing.assert_close(found.sum(0), expected[:, 0], rtol=1e-10, atol=1e-10)


def test_one_splat_and_no_splats_are_summed(rasterizer):
    cameras = two_cameras(17, 9)
    weights = signed_weights(cameras)
    assert rasterizer.contributions(scene(0), cameras, weights).shape == (2, 0)
    one = random_splats(1, 1, dtype=torch.float64)
    found = rasterizer.contributions(one, cameras, weights)
    expected = (rasterizer.render(one, cameras).alpha * weights).sum((1, 2))
    torch.testing.assert_close(found, expected, rtol=1e-10, atol=1e-10)


def test_colours_and_other_channels_make_no_difference(rasterizer):
    splats, cameras = scene(), two_cameras(20, 12)
    weights = signed_weights(cameras)
    plain = replace(splats, colors=torch.rand(60, 5).double(), extra=torch.rand(60, 4).double())
    settings = RenderSettings(background=torch.rand(5).double(), depth=Depth.EXPECTED)
    found = rasterizer.contributions(plain, cameras, weights, settings)
    assert torch.equal(found, rasterizer.contributions(splats, cameras, weights))


def test_inputs_that_want_gradients_are_summed_without(rasterizer):
    splats = scene().map(lambda tensor: tensor.requires_grad_())
    cameras = two_cameras(20, 12)
    weights = signed_weights(cameras).requires_grad_()
    found = rasterizer.contributions(splats, cameras, weights)
    assert not found.requires_grad
    assert found.abs().max() > 0


@pytest.mark.parametrize("profile", [GSPLAT_1_5, DEFAULT.without_cutoffs()])
def test_other_cut_offs_are_followed(backend, profile):
    splats, cameras = scene(100), two_cameras(20, 12)
    settings, weights = RenderSettings(profile=profile), signed_weights(cameras)
    expected = ReferenceRasterizer().contributions(splats, cameras, weights, settings)
    found = backend.contributions(splats, cameras, weights, settings)
    torch.testing.assert_close(found, expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_any_number_of_threads_and_instruction_set_sums_alike(instruction_set, monkeypatch, dtype):
    splats, cameras = scene(3000, dtype), two_cameras(70, 50, dtype)
    splats = replace(splats, opacities=0.2 * splats.opacities)
    weights, found = signed_weights(cameras), []
    for threads in (1, 2, 5):
        monkeypatch.setattr("gsfw.rasterizers.cpu.rasterizer.num_threads", lambda n=threads: n)
        found.append(CpuRasterizer().contributions(splats, cameras, weights))
    assert torch.equal(found[0], found[1])
    assert torch.equal(found[0], found[2])
    wide = splats.map(Tensor.double), cameras.to(dtype=torch.float64), weights.double()
    expected = ReferenceRasterizer().contributions(*wide)
    tolerance = 1e-10 if dtype == torch.float64 else 2e-3
    torch.testing.assert_close(found[0].double(), expected, rtol=tolerance, atol=tolerance)


def refused(weights: Tensor, settings: RenderSettings = MEASURED) -> str:
    asked = replace(settings, contribution_weights=weights)
    with pytest.raises(ValueError, match="contribution_weights") as caught:
        ReferenceRasterizer().render(scene(5), two_cameras(8, 6), asked)
    return str(caught.value)


@pytest.mark.unchecked
def test_weights_of_another_form_are_refused():
    weights = torch.ones(2, 6, 8, 1, dtype=torch.float64)
    assert refused(weights[:1]) == (
        "settings.contribution_weights: expected shape [2, 6, 8, 1], found [1, 6, 8, 1]"
    )
    assert refused(weights[..., 0]) == (
        "settings.contribution_weights: expected shape [2, 6, 8, 1], found [2, 6, 8]"
    )
    assert refused(weights.float()) == (
        "settings.contribution_weights: expected torch.float64, found torch.float32"
    )
    assert refused(weights.to("meta")) == (
        "settings.contribution_weights: expected device cpu, found meta"
    )
    assert refused(weights, RenderSettings()) == (
        "settings.contribution_weights: expected Statistic.CONTRIBUTION in settings.statistics"
    )


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_weights_that_are_not_finite_are_refused_with_full_validation_only(bad):
    weights = torch.ones(2, 6, 8, 1, dtype=torch.float64)
    weights[1, 2, 3] = bad
    assert refused(weights).startswith(
        "settings.contribution_weights: expected finite values; 1 of 2 rows are not, "
        "the first is row 1:"
    )
    cheap = replace(MEASURED, contribution_weights=weights, validation=Validation.CHEAP)
    ReferenceRasterizer().render(scene(5), two_cameras(8, 6), cheap)


def test_weights_need_a_rasterizer_that_sums_them():
    weighted = replace(MEASURED, contribution_weights=torch.ones(1, 6, 8, 1))
    assert Feature.WEIGHTED_CONTRIBUTION not in MEASURED.needs().features
    assert Feature.WEIGHTED_CONTRIBUTION in weighted.needs().features
