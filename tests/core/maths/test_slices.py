"""Slices of 4D Gaussians against the textbook, and at the extremes of scale."""

import numpy as np
import pytest
import torch

from gsfw.core.maths.slices import conditional, weights
from gsfw.methods.rotor4d.rotation import Rotation
from gsfw.methods.rotor4d.rotor import Rotor
from gsfw.methods.rotor4d.two_quaternions import TwoQuaternions

DRAWS = 10_000

EXTREMES = {
    "thin in space, long in time": ((1e-4, 1e-4, 1e-4, 10.0), 1.0),
    "all but a point in time": ((0.01, 0.01, 0.01, 1e-8), 1.0),
    "all but endless": ((0.01, 0.01, 0.01, 1e8), 1.0),
    "thinnest and longest": ((1e-4, 1e-4, 1e-4, 1e8), 1.0),
    "a needle": ((1e-6, 1e-6, 1.0, 0.1), 1.0),
    "a needle, all but a point in time": ((1.0, 1e-6, 1e-6, 1e-8), 1.0),
    "far from normalised": ((0.01, 0.02, 0.03, 0.2), 1e4),
    "hardly any numbers": ((0.01, 0.02, 0.03, 0.2), 1e-9),
}
"""Scales in space and time, and the norm of the rotations' numbers."""


def draws(form: Rotation, norm: float = 1.0, n: int = DRAWS, dtype=torch.float64) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    first, second = norm * torch.randn(2, n, 4, generator=generator, dtype=torch.float64)
    return form.matrices(first.to(dtype), second.to(dtype))


def given_time(
    rotation: np.ndarray, scales: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Covariance, velocity and variance of one Gaussian by the textbook."""
    whole = rotation @ np.diag(scales**2) @ rotation.T
    across = whole[:3, 3]
    return whole[:3, :3] - np.outer(across, across) / whole[3, 3], across / whole[3, 3], whole[3, 3]


@pytest.mark.parametrize("form", [Rotor(), TwoQuaternions()])
def test_slices_are_conditional_gaussians(form: Rotation):
    rotations = draws(form, n=100)
    generator = torch.Generator().manual_seed(2)
    scales = 0.05 + torch.rand(100, 4, generator=generator, dtype=torch.float64)
    sliced = conditional(rotations, scales)
    for row in range(100):
        covariance, velocity, variance = given_time(
            rotations[:, :, row].numpy(), scales[row].numpy()
        )
        np.testing.assert_allclose(sliced.covariances[row], covariance, rtol=0, atol=1e-13)
        np.testing.assert_allclose(sliced.velocities[row], velocity, rtol=1e-11)
        np.testing.assert_allclose(sliced.variances[row], variance, rtol=1e-13)


def test_weights_are_the_density_relative_to_the_centre():
    elapsed = torch.tensor([0.0, 0.3, -0.3, 2.0], dtype=torch.float64)
    found = weights(elapsed, torch.full((4,), 0.09, dtype=torch.float64))
    expected = np.exp([0.0, -0.5, -0.5, -4.0 / 0.18])
    np.testing.assert_allclose(found, expected, rtol=1e-14)


@pytest.mark.parametrize("form", [Rotor(), TwoQuaternions()], ids=["rotor", "quaternions"])
@pytest.mark.parametrize("name", EXTREMES)
def test_slices_at_extremes_are_finite_positive_and_accurate_in_float32(name: str, form: Rotation):
    values, norm = EXTREMES[name]
    scales = torch.tensor(values, dtype=torch.float64).expand(DRAWS, 4)
    rotations = draws(form, norm, dtype=torch.float32)
    sliced = conditional(rotations, scales.float())
    covariances = sliced.covariances
    assert all(
        bool(part.isfinite().all())
        for part in (covariances, sliced.velocities, sliced.variances, sliced.factors)
    )
    assert torch.equal(covariances, covariances.transpose(1, 2))
    largest = covariances.double().flatten(1).abs().amax(1)
    eigenvalues = torch.linalg.eigvalsh(covariances.double())
    assert bool((eigenvalues[:, 0] >= -1e-6 * largest).all())
    exact = conditional(rotations.double(), scales).covariances
    # Rounding of the rotation itself is not an error of slicing: both have the same one.
    error = (covariances - exact).flatten(1).abs().amax(1) / exact.flatten(1).abs().amax(1)
    assert float(error.max()) < 1e-5


def test_the_textbook_formula_would_not_do():
    rotations = draws(Rotor(), dtype=torch.float32).permute(2, 0, 1)
    scales = torch.tensor([1e-4, 1e-4, 1e-4, 10.0])
    whole = (rotations * scales.square()) @ rotations.transpose(1, 2)
    across = whole[:, :3, 3:]
    naive = whole[:, :3, :3] - across @ across.transpose(1, 2) / whole[:, 3:, 3:]
    assert float((torch.linalg.eigvalsh(naive)[:, 0] < 0).float().mean()) > 0.9


def test_gradients_are_those_of_finite_differences():
    rotations = draws(Rotor(), n=4).requires_grad_()
    generator = torch.Generator().manual_seed(2)
    scales = 0.1 + torch.rand(4, 4, generator=generator, dtype=torch.float64)

    def sliced(rotations: torch.Tensor, scales: torch.Tensor) -> tuple[torch.Tensor, ...]:
        found = conditional(rotations, scales)
        return found.covariances, found.velocities, found.variances

    assert torch.autograd.gradcheck(sliced, (rotations, scales.requires_grad_()))


def test_no_row_is_sliced_too():
    sliced = conditional(draws(Rotor(), n=0), torch.zeros(0, 4, dtype=torch.float64))
    assert sliced.covariances.shape == (0, 3, 3)
    assert sliced.velocities.shape == (0, 3)
