"""Rotations of quaternions of any norm, and their gradient, against the reference."""

import pytest
import torch

from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.numerics import QUATERNION_MIN_NORM

pytestmark = pytest.mark.slow  # Compiles the headers; plain runs test them in the rasterizers.


def quaternions(scale: float) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    quats = torch.randn(64, 4, generator=generator, dtype=torch.float64)
    quats[:4] = torch.eye(4)
    gradients = torch.randn(64, 9, generator=generator, dtype=torch.float64)
    return scale * quats, gradients


@pytest.mark.parametrize("kind", ["double", "single", "pair"])
@pytest.mark.parametrize("scale", [1e-20, 1e-11, 1.0, 1e20])
def test_rotations_and_gradients_are_the_references(request, kind, scale):
    maths = request.getfixturevalue(kind)
    tolerance = 1e-6 if kind == "single" else 1e-14
    quats, gradients = quaternions(scale)
    quats = quats.to(maths.dtype).double().requires_grad_()
    matrices = rotation_matrices(quats)
    (expected,) = torch.autograd.grad(matrices.flatten(1), quats, gradients)
    result = maths.call("rotate", [quats, gradients], 13, QUATERNION_MIN_NORM).double()
    assert (result[:, :9] - matrices.flatten(1)).norm() <= tolerance * matrices.norm()
    assert (result[:, 9:] - expected).norm() <= tolerance * expected.norm()


def test_none_is_the_identity_with_gradient_zero(single):
    quats = torch.zeros(2, 4)
    quats[1, 2] = 0.9 * QUATERNION_MIN_NORM
    result = single.call("rotate", [quats, torch.ones(2, 9)], 13, QUATERNION_MIN_NORM)
    expected = torch.cat([torch.eye(3).reshape(-1), torch.zeros(4)]).repeat(2, 1)
    assert torch.equal(result, expected)


def test_opposite_quaternions_have_equal_matrices_and_opposite_gradients(double):
    quats, gradients = quaternions(1.0)
    here = double.call("rotate", [quats, gradients], 13, QUATERNION_MIN_NORM)
    there = double.call("rotate", [-quats, gradients], 13, QUATERNION_MIN_NORM)
    assert torch.equal(here[:, :9], there[:, :9])
    assert torch.equal(here[:, 9:], -there[:, 9:])
