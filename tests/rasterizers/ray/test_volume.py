"""The volume of Gaussians, against closed forms."""

import math
from dataclasses import replace

import pytest
import torch
from support.scenes import random_splats, turned_camera

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.rasterizers.ray.peak import Peak
from gsfw.rasterizers.ray.rasterizer import RayRasterizer
from gsfw.rasterizers.ray.volume import Volume

SMOOTH = RenderSettings(profile=DEFAULT.without_cutoffs(), depth=Depth.ACCUMULATED)


def one_pixel():
    """A camera at the origin whose only ray is the +z axis."""
    intrinsics = torch.tensor([[1.0, 0, 0.5], [0, 1.0, 0.5], [0, 0, 1]], dtype=torch.float64)
    return Cameras(torch.eye(4, dtype=torch.float64)[None], intrinsics[None], 1, 1)


def in_a_row(depths, deviations, opacities, asides=(0.0, 0.0)):
    """Spheres on the ray or beside it, each of a channel of its own."""
    count = len(depths)
    return Splats(
        means=torch.tensor(
            [[aside, 0.0, depth] for depth, aside in zip(depths, asides, strict=False)],
            dtype=torch.float64,
        ),
        opacities=torch.tensor(opacities, dtype=torch.float64),
        colors=torch.eye(count, dtype=torch.float64),
        quats=torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64).repeat(count, 1),
        scales=torch.tensor([[s] * 3 for s in deviations], dtype=torch.float64),
    )


def integral(depths, deviations, opacities, steps=400_001):
    """What the ray sees of spheres on it: colours and depth, by Simpson's rule and erf."""
    t = torch.linspace(0, 10, steps, dtype=torch.float64)
    density, optical = [], torch.zeros_like(t)
    for depth, deviation, opacity in zip(depths, deviations, opacities, strict=True):
        whole = -math.log1p(-opacity)
        turns = (t - depth) / deviation
        density.append(whole * (-0.5 * turns**2).exp() / (math.sqrt(2 * math.pi) * deviation))
        ahead = torch.special.ndtr(turns) - torch.special.ndtr(torch.tensor(-depth / deviation))
        optical = optical + whole * ahead
    emitted = torch.stack(density) * (-optical).exp()
    factors = torch.full_like(t, 2.0)
    factors[1::2], factors[0], factors[-1] = 4.0, 1.0, 1.0
    factors *= (t[1] - t[0]) / 3
    return emitted @ factors, (emitted.sum(0) * t) @ factors, 1 - (-optical[-1]).exp()


@pytest.mark.parametrize("opacity", [0.02, 0.5, 0.99])
@pytest.mark.parametrize("quat", [(1.0, 0, 0, 0), (0.7, 0.3, -0.5, 0.2)])
def test_a_lone_gaussian_has_the_alpha_of_splatting_along_the_ray_through_its_centre(opacity, quat):
    splats = replace(
        in_a_row([4.0], [0.0], [opacity]),
        scales=torch.tensor([[0.3, 0.05, 0.2]], dtype=torch.float64),
        quats=torch.tensor([quat], dtype=torch.float64),
    )
    for matched in (True, False):
        image = RayRasterizer(Volume(64), matched).render(splats, one_pixel(), SMOOTH)
        assert image.alpha.item() == pytest.approx(opacity, abs=1e-6)
        assert image.color.item() == pytest.approx(opacity, abs=1e-6)


def test_beside_the_centre_transmittance_is_a_power_of_what_splatting_has_there():
    # exp(-D^2 / 2) falls off the optical depth here, and alpha in splatting.
    splats = in_a_row([4.0], [0.5], [0.8], [0.6])
    falloff = math.exp(-0.5 * (0.6 / 0.5) ** 2)
    # The ray passes the sphere, whose section is the same from all sides.
    image = RayRasterizer(Volume(64), matched=False).render(splats, one_pixel(), SMOOTH)
    assert image.alpha.item() == pytest.approx(1 - 0.2**falloff, abs=1e-6)
    peak = RayRasterizer(Peak(), matched=False).render(splats, one_pixel(), SMOOTH)
    assert peak.alpha.item() == pytest.approx(0.8 * falloff, abs=1e-12)


@pytest.mark.parametrize("gap", [0.0, 0.3, 2.0])
def test_two_gaussians_mix_where_they_overlap_and_hide_each_other_where_not(gap):
    depths, deviations, opacities = (3.0, 3.0 + gap), (0.3, 0.2), (0.7, 0.9)
    splats = in_a_row(depths, deviations, opacities)
    expected, depth, alpha = integral(depths, deviations, opacities)
    image = RayRasterizer(Volume(2048), matched=False).render(splats, one_pixel(), SMOOTH)
    torch.testing.assert_close(image.color[0, 0, 0], expected, rtol=0, atol=1e-5)
    assert image.alpha.item() == pytest.approx(alpha.item(), abs=1e-6)
    assert image.depth.item() == pytest.approx(depth.item(), abs=1e-4)
    # Alpha is what splatting has, whatever the order; colours are so only when they are apart.
    assert alpha.item() == pytest.approx(1 - 0.3 * 0.1, abs=1e-9)
    painted = (
        RayRasterizer(Peak(), matched=False).render(splats, one_pixel(), SMOOTH).color[0, 0, 0]
    )
    torch.testing.assert_close(painted, torch.tensor([0.7, 0.3 * 0.9], dtype=torch.float64))
    difference = (painted - expected).abs().max().item()
    assert difference < 1e-5 if gap == 2.0 else difference > 0.05


def errors(counts, seeds=(None,)):
    """Of the colours of two overlapping Gaussians, by number of samples: root mean squares."""
    depths, deviations, opacities = (3.0, 3.2), (0.3, 0.2), (0.7, 0.9)
    splats = in_a_row(depths, deviations, opacities)
    expected, _, _ = integral(depths, deviations, opacities)
    found = []
    for count in counts:
        squares = 0.0
        for seed in seeds:
            drawn = RayRasterizer(Volume(count, seed), matched=False)
            color = drawn.render(splats, one_pixel(), SMOOTH).color[0, 0, 0]
            squares += (color - expected).square().sum().item()
        found.append(math.sqrt(squares / len(seeds)))
    return found


def test_the_error_of_middles_falls_with_the_square_of_the_samples():
    few, more, many = errors((32, 128, 512))
    assert few / more == pytest.approx(16, rel=0.15)
    assert more / many == pytest.approx(16, rel=0.15)


def test_the_error_of_random_samples_falls_with_the_three_halfth_power_of_their_number():
    few, many = errors((16, 256), seeds=range(40))
    assert math.log(few / many) / math.log(16) == pytest.approx(1.5, abs=0.25)


def test_random_samples_are_those_of_their_seed_whatever_the_chunks():
    splats = random_splats(20, 1, dtype=torch.float64)
    camera = turned_camera().resized(12, 9)
    first, again, other = (
        RayRasterizer(Volume(8, seed), chunk_mb=chunk).render(splats, camera).color
        for seed, chunk in ((0, 64.0), (0, 0.1), (1, 64.0))
    )
    torch.testing.assert_close(first, again, rtol=0, atol=1e-12)
    assert (first - other).abs().max() > 1e-3


@pytest.mark.parametrize("model", list(CameraModel))
def test_the_order_of_rows_and_depths_does_not_matter(model):
    splats = random_splats(20, 1, dtype=torch.float64)
    camera = turned_camera(model).resized(12, 9)
    ray = RayRasterizer(Volume(16))
    image = ray.render(splats, camera).color
    turned = ray.render(splats.map(lambda tensor: tensor.flip(0)), camera).color
    torch.testing.assert_close(image, turned, rtol=0, atol=1e-12)


def test_weights_contributions_and_background_add_up():
    splats = random_splats(20, 1, dtype=torch.float64)
    settings = RenderSettings(
        background=torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64),
        statistics=frozenset({Statistic.CONTRIBUTION}),
    )
    ray = RayRasterizer(Volume(32))
    output = ray.render(splats, turned_camera(), settings)
    contribution = output.statistics.contribution
    assert contribution.sum().item() == pytest.approx(output.alpha.sum().item(), rel=1e-9)
    plain = ray.render(splats, turned_camera()).color
    torch.testing.assert_close(
        output.color, plain + (1 - output.alpha) * settings.background, rtol=0, atol=1e-12
    )


def test_what_reaches_behind_the_eye_counts_from_the_eye_on():
    splats = in_a_row([0.5], [0.5], [0.8])
    image = RayRasterizer(Volume(256), matched=False).render(splats, one_pixel(), SMOOTH)
    seen = 1 - 0.5 * math.erfc(1 / math.sqrt(2))
    assert image.alpha.item() == pytest.approx(1 - 0.2**seen, abs=1e-4)
