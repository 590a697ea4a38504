"""Channels: every image of a model, of every backend."""

from dataclasses import replace

import pytest
import torch
from support.backends import BACKENDS, NAMES
from support.moving_scene import WHITE, camera_at, two_balls

from gsfw.core.capabilities import Feature
from gsfw.core.errors import ConfigError, UnavailableError
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.rendering.channels import (
    CHANNELS,
    available_channels,
    find_channel,
    render_channels,
)
from gsfw.rendering.normals import camera_points, surface_normals
from gsfw.rendering.shot import Shot

NOW = torch.tensor(0.5)


def image(name, model=None, rasterizer=None, target=None, valid=None):
    shot = Shot(
        model or two_balls(),
        rasterizer or ReferenceRasterizer(),
        camera_at(0.5),
        WHITE,
        NOW,
        target,
        valid,
    )
    return render_channels([CHANNELS[name]], shot)[0]


def test_every_channel_has_the_form_of_its_kind():
    target = torch.zeros(24, 32, 3)
    for name, channel in CHANNELS.items():
        found = image(name, target=target)
        shape = (24, 32, 3) if channel.kind == "color" else (24, 32)
        assert found.shape == shape, name
        assert bool(found.isfinite().any()), name
        if channel.kind == "color":
            assert 0 <= float(found.min()) <= float(found.max()) <= 1


@pytest.mark.parametrize("name", NAMES)
def test_every_backend_renders_every_channel_as_the_reference_does(name):
    rasterizer, target = BACKENDS[name](), torch.zeros(24, 32, 3)
    for channel in CHANNELS:
        expected, found = image(channel, target=target), image(channel, None, rasterizer, target)
        difference = (found.nan_to_num(-1) - expected.nan_to_num(-1)).abs()
        assert float(difference.flatten().quantile(0.98)) < 1e-3, channel


def test_a_pixel_without_a_surface_has_no_value():
    alpha, depth = image("alpha"), image("depth")
    assert bool((depth.isfinite() == (alpha >= 0.5)).all())
    assert float(depth[depth.isfinite()].mean()) == pytest.approx(3.0, abs=0.3)


def test_depth_is_the_same_where_the_rasterizer_has_no_depth():
    class Poor(ReferenceRasterizer):
        @classmethod
        def capabilities(cls):
            able = ReferenceRasterizer.capabilities()
            lacking = {Feature.DEPTH, Feature.CONTRIBUTION}
            return replace(able, features=able.features - lacking)

    found, expected = image("depth", rasterizer=Poor()), image("depth")
    assert torch.allclose(found.nan_to_num(0), expected.nan_to_num(0), atol=1e-3)
    with pytest.raises(UnavailableError, match="measures contributions"):
        image("contribution", rasterizer=Poor())


def test_the_count_is_the_number_of_gaussians_whose_alpha_can_be_seen():
    model = two_balls()
    splats = model.splats(NOW)
    expected = torch.zeros(24, 32)
    for row in range(len(splats)):
        one = splats.take(torch.tensor([row]))
        expected += ReferenceRasterizer().render(one, camera_at(0.5)).alpha[0, ..., 0] > 0
    assert torch.equal(image("count"), expected)


def test_the_contributions_of_opaque_gaussians_are_their_pixels():
    found = image("contribution")
    assert 1 < float(found[found.isfinite()].max()) < 24 * 32


def test_the_motion_is_that_of_the_gaussians():
    model = two_balls(velocity=0.8)
    found = image("motion", model)
    speeds = model.velocities.values.detach().norm(dim=1)
    assert float(speeds.max()) == pytest.approx(0.8)
    assert float(found[found.isfinite()].max()) == pytest.approx(0.8, rel=1e-3)
    for time in (0.0, 1.0):
        shot = Shot(model, ReferenceRasterizer(), camera_at(time), WHITE, torch.tensor(time))
        (ends,) = render_channels([CHANNELS["motion"]], shot)
        assert float(ends.nan_to_num(0).max()) == pytest.approx(0.8, rel=1e-3)


def test_the_error_is_the_mean_difference_and_unknown_pixels_have_none():
    color = image("color")
    target = color + torch.tensor([0.3, 0.0, 0.0])
    valid = torch.ones(24, 32, 1, dtype=torch.bool)
    valid[0, 0] = False
    error = image("error", target=target.clamp_max(1), valid=valid)
    red = (target[5, 5, 0].clamp_max(1) - image("color")[5, 5, 0]) / 3
    assert float(error[5, 5]) == pytest.approx(float(red), abs=1e-6)
    assert bool(error[0, 0].isnan())


def test_the_normals_of_a_wall_lead_to_the_camera():
    camera = camera_at(None)
    flat = surface_normals(torch.full((24, 32), 2.0), camera)
    assert torch.allclose(flat, torch.tensor([0.0, 0.0, -1.0]).expand(24, 32, 3), atol=1e-5)
    points = camera_points(torch.full((24, 32), 2.0), camera)
    # The wall z = 2 + x: its normal is (1, 0, -1) / sqrt(2).
    slope = points[..., 0] / points[..., 2]
    tilted = surface_normals(2.0 / (1 - slope), camera)
    assert torch.allclose(tilted[5, 5], torch.tensor([0.5**0.5, 0.0, -(0.5**0.5)]), atol=1e-3)


def test_several_channels_are_those_rendered_alone():
    names = ["normals", "color", "depth", "alpha"]
    asked = [CHANNELS[name] for name in names]
    shot = Shot(two_balls(), ReferenceRasterizer(), camera_at(0.5), WHITE, NOW)
    together = render_channels(asked, shot)
    for name, found in zip(names, together, strict=True):
        assert torch.equal(found.nan_to_num(-1), image(name).nan_to_num(-1))


def test_a_channel_that_cannot_be_rendered_says_what_it_lacks():
    with pytest.raises(ConfigError, match="compares with a photo, and this view has none"):
        image("error")
    shot = Shot(two_balls(), ReferenceRasterizer(), camera_at(None), WHITE)
    with pytest.raises(ConfigError, match="needs a model that changes with time"):
        render_channels([CHANNELS["motion"]], shot)
    with pytest.raises(ConfigError, match=r"no channel 'dept'\. Did you mean 'depth'\?"):
        find_channel("dept")


def test_a_still_model_without_photos_has_the_other_channels():
    names = [channel.name for channel in available_channels(moves=False, has_images=False)]
    assert names == ["color", "depth", "alpha", "normals", "contribution", "count", "sh_degree"]
    assert len(available_channels(moves=True, has_images=True)) == len(CHANNELS)
