"""Gradients along rays against finite differences, without cut-offs, and in chunks."""

from dataclasses import replace
from itertools import product

import pytest
import torch
from support.sampling import sampled
from support.scenes import front_camera, random_splats, turned_camera

from gsfw.core.cameras import CameraModel
from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.splats import Sh
from gsfw.rasterizers.ray.peak import Peak
from gsfw.rasterizers.ray.rasterizer import RayRasterizer
from gsfw.rasterizers.ray.volume import Volume

SMOOTH = RenderSettings(profile=DEFAULT.without_cutoffs(), depth=Depth.ACCUMULATED)
MODES = {
    "mean": RayRasterizer(Peak("mean")),
    "ray": RayRasterizer(Peak("ray")),
    "no dilation": RayRasterizer(matched=False),
    "volume": RayRasterizer(Volume(6)),
}


def scene(form, extra=False):
    """Three Gaussians as tensors by name."""
    splats = random_splats(3, 1, seed=3, dtype=torch.float64)
    splats = replace(splats, scales=3 * splats.scales)
    if form == "covariances":
        axes = rotation_matrices(splats.quats) * splats.scales[:, None]
        splats = replace(splats, quats=None, scales=None, covariances=axes @ axes.transpose(1, 2))
    return replace(splats, extra=splats.means.clone()) if extra else splats


def check(rasterizer, splats, camera):
    names, tensors = zip(*splats.tensors().items(), strict=True)
    inputs = [tensor.clone().requires_grad_() for tensor in tensors]
    inputs += [t.clone().requires_grad_() for t in (camera.world_to_camera, camera.intrinsics)]

    def draw(*values):
        *of_splats, pose, intrinsics = values
        fields = dict(zip(names, of_splats, strict=True))
        fields["colors"] = replace(splats.colors, coefficients=fields["colors"])
        posed = replace(camera, world_to_camera=pose, intrinsics=intrinsics)
        # Finite differences give the intrinsics a skew, which is refused; it is not drawn either.
        settings = replace(SMOOTH, validation=SMOOTH.validation.CHEAP)
        output = rasterizer.render(replace(splats, **fields), posed, settings)
        parts = (output.color, output.alpha, output.depth, output.extra)
        return tuple(part for part in parts if part is not None)

    assert torch.autograd.gradcheck(draw, inputs, atol=1e-6, rtol=1e-4, fast_mode=True)


@pytest.mark.parametrize(
    ("mode", "model"), sampled(list(product(MODES, CameraModel)), daily=(0, 4, 8, 9))
)
def test_gradients_are_those_of_finite_differences(mode, model):
    camera = turned_camera(model).resized(5, 4)
    check(MODES[mode], scene("axes", extra=True), camera)


@pytest.mark.parametrize("mode", list(MODES))
def test_gradients_of_covariances_are_those_of_finite_differences(mode):
    check(MODES[mode], scene("covariances"), turned_camera().resized(5, 4))


@pytest.mark.parametrize("mode", ["mean", "volume"])
def test_many_chunks_have_the_image_and_the_gradient_of_one(mode):
    splats = random_splats(40, 1, seed=5, dtype=torch.float64)
    camera = front_camera(9, 7, distance=2.5, dtype=torch.float64)
    colors, gradients = [], []
    for chunk_mb in (0.05, 64.0):
        means = splats.means.clone().requires_grad_()
        coefficients = splats.colors.coefficients.clone().requires_grad_()
        inputs = replace(splats, means=means, colors=Sh(coefficients, 1))
        output = RayRasterizer(MODES[mode].mode, chunk_mb=chunk_mb).render(inputs, camera)
        (output.color.square().sum() + output.alpha.sum()).backward()
        colors.append(output.color)
        gradients.append(torch.cat([means.grad, coefficients.grad.flatten(1)], dim=1))
    torch.testing.assert_close(colors[0], colors[1], rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(gradients[0], gradients[1], rtol=1e-10, atol=1e-10)


def test_clamped_and_skipped_alphas_have_no_gradient():
    splats = random_splats(1, 0, dtype=torch.float64)
    splats = replace(splats, means=torch.zeros(1, 3, dtype=torch.float64))
    for opacity, has_gradient in ((1.0, False), (0.5, True)):
        opacities = torch.tensor([opacity], dtype=torch.float64, requires_grad=True)
        camera = front_camera(1, 1, dtype=torch.float64)
        MODES["mean"].render(replace(splats, opacities=opacities), camera).alpha.sum().backward()
        assert bool(opacities.grad.item()) == has_gradient
