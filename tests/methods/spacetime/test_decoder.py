"""Feature colours: rays of pixels, and the network, in float64."""

from dataclasses import replace

import pytest
import torch
from moving_splats import at, seeded, spacetime
from scenes import front_camera

from gsfw.core.cameras import CameraModel
from gsfw.core.evaluation import draw
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.methods.spacetime.decoder import FeatureDecoder
from gsfw.methods.spacetime.rays import pixel_rays
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

BACKGROUND = RenderSettings(background=torch.tensor([0.2, 0.5, 0.9], dtype=torch.float64))


def turned_camera(model: CameraModel = CameraModel.PINHOLE):
    """A camera that looks at the origin from the side, and whose centre is not in the middle."""
    camera = front_camera(dtype=torch.float64)
    turn = torch.linalg.qr(torch.randn(3, 3, generator=seeded(4), dtype=torch.float64))[0]
    pose = camera.world_to_camera.clone()
    pose[0, :3, :3] = turn * turn.det()
    intrinsics = camera.intrinsics.clone()
    intrinsics[0, :2, 2] += torch.tensor([3.0, -2.0])
    if model is CameraModel.ORTHOGRAPHIC:
        intrinsics[0, [0, 1], [0, 1]] = 10.0
    return replace(camera, world_to_camera=pose, intrinsics=intrinsics, model=model)


@pytest.mark.parametrize("model", list(CameraModel))
@pytest.mark.parametrize("pixel", [(5, 7), (22, 31)])
def test_what_lies_on_the_ray_of_a_pixel_is_drawn_there(model, pixel):
    camera = turned_camera(model)
    rays = pixel_rays(camera)
    assert rays.shape == (1, camera.height, camera.width, 6)
    origin, direction = rays[0, pixel[0], pixel[1]].split(3)
    assert float(direction.norm()) == pytest.approx(1.0)
    splats = Splats(
        means=(origin + 4.0 * direction)[None],
        opacities=torch.ones(1, dtype=torch.float64),
        colors=torch.ones(1, 1, dtype=torch.float64),
        quats=torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64),
        scales=torch.full((1, 3), 0.02, dtype=torch.float64),
    )
    alpha = ReferenceRasterizer().render(splats, camera, RenderSettings()).alpha[0, :, :, 0]
    rows, columns = (torch.arange(size, dtype=torch.float64) for size in alpha.shape)
    found = (
        (alpha.sum(1) * rows).sum() / alpha.sum(),
        (alpha.sum(0) * columns).sum() / alpha.sum(),
    )
    assert [float(value) for value in found] == pytest.approx(pixel, abs=0.02)


def test_a_ray_begins_at_the_camera():
    camera = turned_camera()
    origins = pixel_rays(camera)[..., :3]
    torch.testing.assert_close(origins, camera.centers.expand_as(origins))


def test_pictures_are_decoded_pixel_by_pixel_as_the_paper_says():
    model, camera = spacetime(colors="features"), turned_camera()
    splats = model.splats(at(0.4))
    drawn = ReferenceRasterizer().render(splats, camera, model.settings(BACKGROUND))
    decoded = draw(model, ReferenceRasterizer(), camera, BACKGROUND, at(0.4))
    assert model.decoder is not None
    assert drawn.extra is not None
    first, second = model.decoder.first.detach(), model.decoder.second.detach()
    rays = pixel_rays(camera)
    for row, column in ((0, 0), (15, 20), (12, 25)):
        inputs = torch.cat([drawn.extra[0, row, column], rays[0, row, column]]).detach()
        hidden = torch.stack([(weights * inputs).sum().clamp_min(0) for weights in first])
        added = torch.stack([(weights * hidden).sum() for weights in second])
        expected = drawn.color[0, row, column] + drawn.alpha[0, row, column] * added
        torch.testing.assert_close(decoded.color[0, row, column], expected.detach())


def test_what_is_empty_stays_the_background_exactly():
    model, camera = spacetime(n=2, colors="features"), turned_camera()
    decoded = draw(model, ReferenceRasterizer(), camera, BACKGROUND, at(0.4))
    empty = decoded.alpha[..., 0] == 0
    assert bool(empty.any())
    assert BACKGROUND.background is not None
    assert bool((decoded.color[empty] == BACKGROUND.background).all())


def test_a_new_decoder_adds_nothing_yet_and_has_90_weights():
    decoder = FeatureDecoder(seeded())
    features, rays = (torch.randn(1, 2, 3, 6, generator=seeded(1)) for _ in range(2))
    assert not decoder.correction(features, rays).any()
    assert sum(weights.numel() for weights in decoder.parameters()) == 90
    assert torch.equal(decoder.first, FeatureDecoder(seeded()).first)


def test_gradients_reach_features_and_weights():
    model, camera = spacetime(n=6, colors="features"), turned_camera()
    output = ReferenceRasterizer().render(model.splats(at(0.4)), camera, RenderSettings())
    model.decode(output, camera).color.square().sum().backward()
    (group,) = model.parameter_groups()
    assert group.name == "decoder"
    assert all(
        weights.grad is not None and bool(weights.grad.any()) for weights in group.parameters
    )
    for name in ("features", "feature_rates", "sh_dc", "motion"):
        gradient = model.columns()[name].values.grad
        assert gradient is not None
        assert bool(gradient.any()), name


def test_without_features_there_is_nothing_to_decode():
    model, camera = spacetime(), turned_camera()
    output = ReferenceRasterizer().render(model.splats(at(0.4)), camera, RenderSettings())
    assert model.decode(output, camera) is output
    assert model.parameter_groups() == ()
