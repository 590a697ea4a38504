"""Gradients against finite differences, in float64 with every cut-off disabled."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Sh, Splats

SMOOTH = DEFAULT.without_cutoffs()


def camera_of(model: CameraModel) -> Cameras:
    camera = replace(front_camera(9, 7, dtype=torch.float64), model=model)
    if model is CameraModel.ORTHOGRAPHIC:
        camera = replace(
            camera, intrinsics=camera.intrinsics * torch.tensor([[0.3], [0.3], [1.0]]).double()
        )
    return camera


def check(function, named: dict[str, torch.Tensor]) -> None:
    """Check d function / d every tensor; its outputs are mixed with fixed random weights."""
    inputs = [tensor.detach().clone().requires_grad_() for tensor in named.values()]

    def mixed(*tensors: torch.Tensor) -> torch.Tensor:
        outputs = function(dict(zip(named, tensors, strict=True)))
        generator = torch.Generator().manual_seed(0)
        weights = [torch.randn(o.shape, generator=generator, dtype=o.dtype) for o in outputs]
        return torch.stack([(o * w).sum() for o, w in zip(outputs, weights, strict=True)])

    assert torch.autograd.gradcheck(mixed, inputs, eps=1e-6, atol=1e-6, rtol=1e-4, fast_mode=True)


@pytest.mark.parametrize("model", list(CameraModel))
@pytest.mark.parametrize("antialias", [False, True])
def test_every_input_has_the_right_gradient(rasterizer, model, antialias):
    splats = random_splats(4, 2, seed=1, dtype=torch.float64)
    camera = camera_of(model)
    assert isinstance(splats.colors, Sh)
    named = splats.tensors() | {
        "extra": torch.rand(4, 2, dtype=torch.float64),
        "background": torch.rand(3, dtype=torch.float64),
        "world_to_camera": camera.world_to_camera,
    }

    def function(given: dict[str, torch.Tensor]) -> list[torch.Tensor]:
        scene = Splats(
            given["means"],
            given["opacities"],
            Sh(given["colors"], 2),
            given["quats"],
            given["scales"],
            extra=given["extra"],
        )
        settings = RenderSettings(
            background=given["background"],
            antialias=antialias,
            depth=Depth.EXPECTED,
            profile=SMOOTH,
        )
        posed = replace(camera, world_to_camera=given["world_to_camera"])
        output = rasterizer.render(scene, posed, settings)
        assert output.depth is not None
        assert output.extra is not None
        return [output.color, output.alpha, output.depth, output.extra]

    check(function, named)


@pytest.mark.parametrize("antialias", [False, True])
def test_the_covariance_form_has_the_right_gradient(rasterizer, antialias):
    axes = 0.2 * torch.randn(4, 3, 3, generator=torch.Generator().manual_seed(0)).double()
    splats = random_splats(4, 0, seed=2, dtype=torch.float64)
    named = {
        "means": splats.means,
        "opacities": splats.opacities,
        "channels": torch.rand(4, 5, dtype=torch.float64),
        "covariances": axes @ axes.transpose(1, 2),
    }
    camera = camera_of(CameraModel.PINHOLE)

    def function(given: dict[str, torch.Tensor]) -> list[torch.Tensor]:
        scene = Splats(
            given["means"],
            given["opacities"],
            given["channels"],
            covariances=given["covariances"],
        )
        settings = RenderSettings(antialias=antialias, depth=Depth.ACCUMULATED, profile=SMOOTH)
        output = rasterizer.render(scene, camera, settings)
        assert output.depth is not None
        return [output.color, output.alpha, output.depth]

    # Perturbing one of two mirrored entries must count half: that is what symmetry means.
    check(function, named)


def test_ragged_and_dense_coefficients_get_the_same_gradient(rasterizer):
    splats = random_splats(6, 2, seed=3, dtype=torch.float64)
    assert isinstance(splats.colors, Sh)
    ragged = splats.colors.of_degrees(torch.tensor([0, 1, 2, 0, 2, 1]))
    dense = Sh(ragged.dense(), 2).map(lambda tensor: tensor.detach().requires_grad_())
    ragged = ragged.map(lambda tensor: tensor.detach().requires_grad_())
    camera = front_camera(12, 10, dtype=torch.float64)
    for colors in (dense, ragged):
        rasterizer.render(replace(splats, colors=colors), camera).color.square().sum().backward()
    assert dense.coefficients.grad is not None
    assert ragged.offsets is not None
    present = torch.arange(8) < ragged.offsets.diff()[:, None]
    torch.testing.assert_close(dense.coefficients.grad[:, :1], ragged.coefficients.grad)
    torch.testing.assert_close(dense.coefficients.grad[:, 1:][present], ragged.rest.grad)


def test_opposite_quaternions_draw_the_same_and_have_opposite_gradients(rasterizer):
    splats = random_splats(10, 1, dtype=torch.float64)
    assert splats.quats is not None
    camera = front_camera(dtype=torch.float64)
    images, gradients = [], []
    for sign in (1, -1):
        quats = (sign * splats.quats).requires_grad_()
        color = rasterizer.render(replace(splats, quats=quats), camera).color
        color.square().sum().backward()
        images.append(color)
        gradients.append(quats.grad)
    assert torch.equal(images[0], images[1])
    assert gradients[0] is not None
    assert gradients[1] is not None
    assert torch.equal(gradients[0], -gradients[1])


def test_a_quaternion_without_length_is_the_identity_and_has_no_gradient(rasterizer):
    splats = random_splats(3, 0, dtype=torch.float64)
    camera = front_camera(dtype=torch.float64)
    identity = torch.tensor([[1.0, 0, 0, 0]] * 3, dtype=torch.float64)
    short = torch.tensor([[0.0] * 4, [1e-20] * 4, [1e-20, 0, 0, 0]], dtype=torch.float64)
    short.requires_grad_()
    images = [
        rasterizer.render(replace(splats, quats=quats), camera).color for quats in (identity, short)
    ]
    assert torch.equal(images[0], images[1])
    images[1].square().sum().backward()
    assert short.grad is not None
    assert short.grad.abs().max() == 0


def test_the_gradient_of_a_quaternion_falls_with_its_length(rasterizer):
    splats = random_splats(5, 0)
    assert splats.quats is not None
    unit = splats.quats / splats.quats.norm(dim=1, keepdim=True)
    gradients = []
    for length in (1.0, 1e20):
        quats = (length * unit).requires_grad_()
        rasterizer.render(
            replace(splats, quats=quats), front_camera()
        ).color.square().sum().backward()
        assert quats.grad is not None
        gradients.append(quats.grad.double() * length)
    torch.testing.assert_close(gradients[0], gradients[1], rtol=1e-3, atol=1e-4)


def test_drawing_without_any_gradient_works(rasterizer):
    splats = random_splats(5, 1)
    output = rasterizer.render(splats, front_camera())
    assert not output.color.requires_grad
    with torch.no_grad():
        means = splats.means.clone().requires_grad_()
        again = rasterizer.render(replace(splats, means=means), front_camera())
    assert torch.equal(again.color, output.color)
