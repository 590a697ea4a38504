"""The whitened falloff, and the gradients that its moments hold, against autograd."""

import math

import pytest
import torch

pytestmark = pytest.mark.slow  # Compiles the headers; plain runs test them in the rasterizers.

PIXELS = 5


def ellipses(n: int = 16) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    """Random covariances [n, 3], opacities [n], offsets [n, p, 2] and dL/d alpha [n, p]."""
    generator = torch.Generator().manual_seed(0)
    axes = torch.randn(n, 2, 2, generator=generator, dtype=torch.float64)
    full = axes @ axes.transpose(1, 2) + 0.3 * torch.eye(2, dtype=torch.float64)
    opacities = 0.05 + 0.9 * torch.rand(n, generator=generator, dtype=torch.float64)
    offsets = 2 * torch.randn(n, PIXELS, 2, generator=generator, dtype=torch.float64)
    gradients = torch.randn(n, PIXELS, generator=generator, dtype=torch.float64)
    return full, opacities, offsets, gradients


def alpha_of(full, opacities, offsets):
    """The textbook: o exp(-d^T Sigma^-1 d / 2)."""
    solved = torch.linalg.solve(full, offsets.transpose(1, 2)).transpose(1, 2)
    return opacities[:, None] * (-0.5 * (solved * offsets).sum(2)).exp()


def rows_of(full, *columns):
    covariance = full.flatten(1)[:, [0, 1, 3]]
    determinants = torch.linalg.det(full)[:, None]
    return torch.cat([covariance, determinants, *columns], dim=1)


@pytest.mark.parametrize("kind", ["double", "single", "pair"])
def test_the_exponent_is_that_of_the_textbook_in_base_two(request, kind):
    maths = request.getfixturevalue(kind)
    full, opacities, offsets, _ = ellipses()
    expected = alpha_of(full, opacities, offsets)
    tolerance = 1e-5 if kind == "single" else 1e-13
    for pixel in range(PIXELS):
        rows = rows_of(full, offsets[:, pixel], opacities.log2()[:, None])
        result = maths.call("falloff", [rows], 4).double()
        error = (result[:, 3].exp2() - expected[:, pixel]).abs()
        assert (error <= tolerance * (1 + result[:, 3].abs()) * expected[:, pixel]).all()


@pytest.mark.parametrize("kind", ["double", "single", "pair"])
def test_moments_hold_the_gradients_of_mean_covariance_and_opacity(request, kind):
    maths = request.getfixturevalue(kind)
    full, opacities, offsets, gradients = ellipses()
    means = torch.zeros(len(full), 2, dtype=torch.float64, requires_grad=True)
    leaves = [means, full.clone().requires_grad_(), opacities.clone().requires_grad_()]
    alphas = alpha_of(leaves[1], leaves[2], offsets - means[:, None])
    expected = torch.autograd.grad(alphas, leaves, gradients)

    # What blending sums, with u and v scaled for binary.
    g = alphas.detach() * gradients
    inverse = torch.linalg.cholesky(full).inverse()
    u, v = (math.sqrt(0.5 * math.log2(math.e)) * offsets @ inverse.transpose(1, 2)).unbind(2)
    sums = [(g * by).sum(1, keepdim=True) for by in (1, u, v, u * u, u * v, v * v)]
    result = maths.call("moments", [rows_of(full, opacities[:, None], *sums)], 6).double()

    mean, covariance, opacity = expected
    wanted = torch.cat([mean, covariance.flatten(1)[:, [0, 1, 3]], opacity[:, None]], dim=1)
    tolerance = 1e-5 if kind == "single" else 1e-13
    assert ((result - wanted).norm(dim=0) <= tolerance * wanted.norm(dim=0)).all()
    # Both off-diagonal entries have the derivative that the one number holds.
    assert torch.allclose(covariance[:, 0, 1], covariance[:, 1, 0])


def test_an_opacity_of_zero_has_gradient_zero(double):
    full, opacities, _, _ = ellipses(2)
    rows = rows_of(full, 0 * opacities[:, None], torch.zeros(2, 6))
    assert (double.call("moments", [rows], 6) == 0).all()
