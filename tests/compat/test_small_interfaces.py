"""simple-knn and fused-ssim; and that no step outlives its image."""

import gc
import weakref

import pytest
import torch
from support import inria_formulas

from gsfw.compat.diff_gaussian_rasterization import GaussianRasterizer
from gsfw.compat.fused_ssim import fused_ssim
from gsfw.compat.gsplat import rasterization
from gsfw.compat.refusal import UnservedArgument
from gsfw.compat.simple_knn._C import distCUDA2


def test_distances_are_mean_squares_to_three_neighbours():
    points = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3], [50, 50, 50]])
    assert distCUDA2(points)[0] == pytest.approx((1 + 4 + 9) / 3)
    with pytest.raises(ValueError, match="more than 3 points, found 3"):
        distCUDA2(points[:3])


def test_similarity_is_that_of_its_formula_at_a_pixel():
    """The window of 11 x 11 pixels, sigma 1.5, in a float64 loop."""
    random = torch.Generator().manual_seed(0)
    first, second = torch.rand(2, 1, 1, 11, 11, generator=random, dtype=torch.float64)
    steps = torch.arange(11, dtype=torch.float64) - 5
    line = torch.exp(-(steps**2) / (2 * 1.5**2))
    window = line[:, None] * line / line.sum() ** 2

    def mean(values):
        return (window * values).sum()

    x, y = first[0, 0], second[0, 0]
    covariance = mean(x * y) - mean(x) * mean(y)
    variances = mean(x * x) - mean(x) ** 2 + mean(y * y) - mean(y) ** 2
    similar = (2 * mean(x) * mean(y) + 1e-4) * (2 * covariance + 9e-4)
    similar = similar / ((mean(x) ** 2 + mean(y) ** 2 + 1e-4) * (variances + 9e-4))
    torch.testing.assert_close(fused_ssim(first, second, padding="valid"), similar)


def test_similarity_has_a_gradient_by_the_rendered_image_in_training_only():
    image = torch.rand(1, 3, 12, 12).requires_grad_()
    truth = torch.rand(1, 3, 12, 12).requires_grad_()
    fused_ssim(image, truth).backward()
    assert image.grad.abs().sum() > 0
    assert truth.grad is None
    assert not fused_ssim(image, truth, train=False).requires_grad
    with pytest.raises(UnservedArgument, match="padding='reflect'"):
        fused_ssim(image, truth, padding="reflect")


@pytest.mark.parametrize("door", ["inria", "gsplat"])
def test_nothing_of_a_step_stays_when_its_image_is_gone(door):
    settings = inria_formulas.camera(12, 10)._replace(sh_degree=0)
    means = torch.zeros(4, 3, dtype=torch.float64, requires_grad=True)
    splats = {
        "opacities": torch.full((4, 1), 0.5, dtype=torch.float64),
        "scales": torch.full((4, 3), 0.2, dtype=torch.float64),
        "colors": torch.ones(4, 1, 3, dtype=torch.float64),
    }
    quats = torch.tensor([[1.0, 0, 0, 0]], dtype=torch.float64).repeat(4, 1)
    if door == "inria":
        points = torch.zeros_like(means, requires_grad=True)
        image = GaussianRasterizer(settings)(
            means,
            points,
            splats["opacities"],
            splats["colors"],
            scales=splats["scales"],
            rotations=quats,
            means2D_densify=points,
        )[0]
    else:
        image, alpha, info = rasterization(
            means,
            quats,
            splats["scales"],
            splats["opacities"][:, 0],
            splats["colors"],
            settings.viewmatrix.T[None],
            torch.tensor([[[9.0, 0, 6], [0, 9, 5], [0, 0, 1]]], dtype=torch.float64),
            12,
            10,
            sh_degree=0,
            absgrad=True,
        )
        info["means2d"].retain_grad()
        del info, alpha
    nodes = [image.grad_fn]
    while "_Render" not in nodes[0].name():
        node = nodes.pop(0)
        nodes += [after for after, _ in node.next_functions if after is not None]
    step = weakref.ref(nodes[0])
    image.sum().backward()
    del image, nodes, node
    gc.collect()
    assert step() is None
