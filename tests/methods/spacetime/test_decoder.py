"""Feature colours: rays of pixels, and the network, in float64."""

import torch
from support.moving_splats import at, seeded, spacetime
from support.scenes import turned_camera

from gsfw.core.loop.evaluation import render_model
from gsfw.core.maths.rays import pixel_rays
from gsfw.core.render_settings import RenderSettings
from gsfw.methods.spacetime.decoder import FeatureDecoder
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

BACKGROUND = RenderSettings(background=torch.tensor([0.2, 0.5, 0.9], dtype=torch.float64))


def test_images_are_decoded_pixel_by_pixel_as_the_paper_says():
    model, camera = spacetime(colors="features"), turned_camera()
    splats = model.splats(at(0.4))
    drawn = ReferenceRasterizer().render(splats, camera, BACKGROUND)
    decoded = render_model(model, ReferenceRasterizer(), camera, BACKGROUND, at(0.4))
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
    decoded = render_model(model, ReferenceRasterizer(), camera, BACKGROUND, at(0.4))
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
