"""Equation 9 of Kheradmand et al. 2024, against its double sum in exact arithmetic."""

import math
from fractions import Fraction

import pytest
import torch

from gsfw.methods.gaussians3d.relocation import coincident_copies


def double_sum(opacity: float, copies: int) -> tuple[float, float]:
    """New opacity and the factor of the scales, as the paper has them."""
    new = 1 - (1 - opacity) ** (1 / copies)
    exact = Fraction(new)
    # Terms of one power are added exactly before the irrational weight is applied.
    powers = [
        sum(math.comb(i, k) for i in range(k, copies)) * (-1) ** k * exact ** (k + 1)
        for k in range(copies)
    ]
    digits = 10**60
    total = sum(
        power * Fraction(math.isqrt(digits * digits // (k + 1)), digits)
        for k, power in enumerate(powers)
    )
    return new, opacity / float(total)


@pytest.mark.parametrize("copies", [1, 2, 3, 10, 51])
@pytest.mark.parametrize("opacity", [1e-4, 0.006, 0.3, 0.9, 0.99999])
def test_it_is_the_double_sum_of_the_paper(opacity, copies):
    logit = torch.tensor([math.log(opacity / (1 - opacity))], dtype=torch.float64)
    new_logits, factors = coincident_copies(logit, torch.tensor([copies]))
    expected_opacity, expected_factor = double_sum(opacity, copies)
    assert float(new_logits.sigmoid()) == pytest.approx(expected_opacity, rel=1e-9)
    assert float(factors) == pytest.approx(expected_factor, rel=1e-9)


def test_one_copy_is_the_row_itself():
    logits = torch.linspace(-12, 12, 25, dtype=torch.float64)
    new_logits, factors = coincident_copies(logits, torch.ones(25, dtype=torch.int64))
    torch.testing.assert_close(new_logits, logits, rtol=1e-9, atol=1e-9)
    torch.testing.assert_close(factors, torch.ones_like(logits), rtol=1e-12, atol=0)


def test_copies_together_have_the_opacity_of_one():
    logits = torch.tensor([-3.0, 0.5, 9.0])
    for copies in (2, 7, 1000):
        new_logits, _ = coincident_copies(logits, torch.full((3,), copies))
        together = 1 - (1 - new_logits.sigmoid()) ** copies
        torch.testing.assert_close(together, logits.double().sigmoid(), rtol=1e-9, atol=0)


@pytest.mark.parametrize("copies", [1, 2, 51, 100_000])
def test_saturated_opacities_stay_finite(copies):
    logits = torch.tensor([-1e30, -200.0, 50.0, 1e30])
    new_logits, factors = coincident_copies(logits, torch.full((4,), copies))
    assert bool(new_logits.isfinite().all())
    assert bool(factors.isfinite().all())
    assert bool((factors > 0).all())
    assert bool((factors <= 1 + 1e-9).all())
