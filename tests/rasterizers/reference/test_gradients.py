"""What only the reference has to get right: its chunks, and gradients by intrinsics."""

from dataclasses import replace

import torch
from support.flat_scenes import flat_camera
from support.scenes import front_camera, random_splats

from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer


def test_many_chunks_have_the_image_and_the_gradient_of_one():
    splats = random_splats(150, 1, seed=5, dtype=torch.float64)
    camera = front_camera(24, 18, distance=2.5, dtype=torch.float64)
    colors, gradients = [], []
    for chunk_mb in (0.01, 64.0):
        means = splats.means.clone().requires_grad_()
        output = ReferenceRasterizer(chunk_mb).render(replace(splats, means=means), camera)
        (output.color.square().sum() + output.alpha.sum()).backward()
        colors.append(output.color)
        gradients.append(means.grad)
    torch.testing.assert_close(colors[0], colors[1], rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(gradients[0], gradients[1], rtol=1e-12, atol=1e-12)


def test_intrinsics_have_a_gradient():
    splats = random_splats(5, 1, dtype=torch.float64)
    camera = flat_camera(20, 20)
    intrinsics = camera.intrinsics.clone().requires_grad_()
    moved = replace(splats, means=10 + 5 * splats.means, scales=10 * splats.scales)
    color = ReferenceRasterizer().render(moved, replace(camera, intrinsics=intrinsics)).color
    color.square().sum().backward()
    assert intrinsics.grad is not None
    assert intrinsics.grad[0, :2].abs().min() == 0, "there is no skew"
    assert intrinsics.grad[0, :2, 2].abs().min() > 0
