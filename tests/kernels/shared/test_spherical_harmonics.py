"""Spherical harmonics, view directions and colours, against core and autograd."""

import pytest
import torch
from torch.nn.functional import normalize

from gsfw.core.maths.spherical_harmonics import MAX_DEGREE, num_coefficients, sh_basis

pytestmark = pytest.mark.slow  # Compiles the headers; plain runs test them in the rasterizers.


@pytest.mark.parametrize("kind", ["double", "single", "pair"])
@pytest.mark.parametrize("degree", range(MAX_DEGREE + 1))
def test_the_basis_and_its_gradient_are_the_references(request, kind, degree):
    maths = request.getfixturevalue(kind)
    tolerance = 1e-5 if kind == "single" else 1e-13
    generator = torch.Generator().manual_seed(degree)
    count = num_coefficients(degree)
    means = torch.randn(64, 3, generator=generator, dtype=torch.float64)
    means[:3] = torch.eye(3)
    center = torch.tensor([0.25, -0.5, 1.5], dtype=torch.float64)
    gradients = torch.randn(64, count, generator=generator, dtype=torch.float64)
    means = means.to(maths.dtype).double().requires_grad_()
    basis = sh_basis(degree, normalize(means - center, dim=1))
    rows = torch.cat([means, gradients], dim=1)
    result = maths.call("harmonics", [rows], count + 3, degree, center).double()
    assert (result[:, :count] - basis).norm() <= tolerance * basis.norm()
    if degree == 0:
        assert (result[:, count:] == 0).all()
    else:
        (expected,) = torch.autograd.grad(basis, means, gradients)
        assert (result[:, count:] - expected).norm() <= tolerance * expected.norm()


@pytest.mark.parametrize("distance", [0.0, 1e-13, 1e-11])
def test_a_mean_at_the_camera_centre_has_a_finite_gradient(double, distance):
    means = torch.full((2, 3), distance, dtype=torch.float64, requires_grad=True)
    gradients = torch.linspace(-1, 1, 2 * 4, dtype=torch.float64).view(2, 4)
    basis = sh_basis(1, normalize(means, dim=1))
    (expected,) = torch.autograd.grad(basis, means, gradients)
    rows = torch.cat([means, gradients], dim=1)
    result = double.call("harmonics", [rows], 7, 1, torch.zeros(3))
    torch.testing.assert_close(result[:, :4], basis.detach())
    assert (result[:, 4:] - expected).norm() <= 1e-13 * expected.norm()


@pytest.mark.parametrize("kind", ["double", "single", "pair"])
def test_colours_are_clamped_at_zero_with_their_gradient(request, kind):
    maths = request.getfixturevalue(kind)
    sums = torch.tensor([-2.0, -0.5000001, -0.5, 0.0, 3.0, torch.inf], dtype=torch.float64)
    sums = sums.to(maths.dtype).requires_grad_()
    gradients = torch.arange(1.0, 7.0, dtype=maths.dtype)
    colors = (sums + 0.5).clamp(min=0)
    (expected,) = torch.autograd.grad(colors, sums, gradients)
    result = maths.call("color", [torch.stack([sums, gradients], dim=1)], 2)
    assert torch.equal(result, torch.stack([colors.detach(), expected], dim=1))
