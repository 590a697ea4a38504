"""Polynomial motion, against sums of powers written out."""

import pytest
import torch

from gsfw.methods.spacetime.polynomial import displacement, recentered


def polynomials(order: int, n: int = 6) -> torch.Tensor:
    generator = torch.Generator().manual_seed(order)
    return torch.randn(n, order, 3, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_displacement_is_a_sum_of_powers(order):
    coefficients = polynomials(order)
    elapsed = torch.linspace(-1, 1, 6, dtype=torch.float64)
    expected = torch.zeros(6, 3, dtype=torch.float64)
    for power in range(1, order + 1):
        expected += coefficients[:, power - 1] * (elapsed**power)[:, None]
    torch.testing.assert_close(displacement(coefficients, elapsed), expected)


def test_nothing_has_moved_at_the_centre():
    assert not displacement(polynomials(3), torch.zeros(6, dtype=torch.float64)).any()


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_a_recentered_path_is_the_same_path(order):
    coefficients = polynomials(order)
    shift = torch.linspace(-0.7, 0.9, 6, dtype=torch.float64)
    moved, start = recentered(coefficients, shift), displacement(coefficients, shift)
    for time in (-1.0, 0.0, 0.3, 1.0):
        elapsed = torch.full((6,), time, dtype=torch.float64)
        expected = displacement(coefficients, elapsed)
        found = start + displacement(moved, elapsed - shift)
        torch.testing.assert_close(found, expected)


def test_no_rows_have_paths_too():
    none = torch.zeros(0, 3, 3)
    assert displacement(none, torch.zeros(0)).shape == (0, 3)
    assert recentered(none, torch.zeros(0)).shape == (0, 3, 3)
