"""The basis against its definition, and what rotating it must do."""

import math

import numpy as np
import pytest
import torch
from scipy.special import lpmv

from gsfw.core.maths.spherical_harmonics import (
    MAX_DEGREE,
    dc_to_rgb,
    degree_of,
    num_coefficients,
    rgb_to_dc,
    rotate_sh,
    sh_basis,
)


def directions(n: int = 50) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    vectors = torch.randn(n, 3, generator=generator, dtype=torch.float64)
    return vectors / vectors.norm(dim=1, keepdim=True)


def defined(band: int, order: int, vectors: torch.Tensor) -> np.ndarray:
    """Real harmonics from associated Legendre functions, which carry the Condon-Shortley sign."""
    x, y, z = vectors.numpy().T
    m = abs(order)
    factor = math.sqrt(
        (2 * band + 1) / (4 * math.pi) * math.factorial(band - m) / math.factorial(band + m)
    )
    legendre = lpmv(m, band, z)
    phi = np.arctan2(y, x)
    if order == 0:
        return factor * legendre
    wave = np.cos(m * phi) if order > 0 else np.sin(m * phi)
    return math.sqrt(2) * factor * wave * legendre


def test_the_basis_is_the_definition():
    vectors = directions()
    basis = sh_basis(MAX_DEGREE, vectors).numpy()
    for band in range(MAX_DEGREE + 1):
        for order in range(-band, band + 1):
            column = band * band + band + order
            np.testing.assert_allclose(
                basis[:, column],
                defined(band, order, vectors),
                rtol=0,
                atol=1e-12,
                err_msg=f"band {band}, order {order}",
            )


def test_lower_degrees_are_the_first_columns():
    vectors = directions()
    whole = sh_basis(MAX_DEGREE, vectors)
    for degree in range(MAX_DEGREE):
        basis = sh_basis(degree, vectors)
        assert basis.shape == (50, num_coefficients(degree))
        torch.testing.assert_close(basis, whole[:, : num_coefficients(degree)])


def test_the_basis_is_orthonormal_on_the_sphere():
    # Gauss-Legendre in z and equal steps in angle integrate these polynomials exactly.
    z, weights = np.polynomial.legendre.leggauss(10)
    phi = 2 * math.pi * np.arange(20) / 20
    zs, phis = torch.tensor(z).repeat_interleave(20), torch.tensor(phi).repeat(10)
    ring = (1 - zs * zs).sqrt()
    basis = sh_basis(MAX_DEGREE, torch.stack([ring * phis.cos(), ring * phis.sin(), zs], dim=1))
    area = torch.tensor(weights).repeat_interleave(20) * 2 * math.pi / 20
    gram = basis.T @ (basis * area[:, None])
    torch.testing.assert_close(gram, torch.eye(25, dtype=torch.float64), rtol=0, atol=1e-12)


def test_the_constant_band_is_the_colour():
    rgb = torch.tensor([[0.0, 0.25, 1.0]], dtype=torch.float64)
    torch.testing.assert_close(dc_to_rgb(rgb_to_dc(rgb)), rgb)
    drawn = 0.5 + sh_basis(0, directions(1)) @ rgb_to_dc(rgb)
    torch.testing.assert_close(drawn, rgb)


def test_degrees_and_counts_belong_together():
    assert [num_coefficients(degree) for degree in range(5)] == [1, 4, 9, 16, 25]
    assert [degree_of(count) for count in (1, 4, 9, 16, 25)] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("count", [0, 2, 15, 36])
def test_other_counts_are_refused(count):
    with pytest.raises(ValueError, match="SH coefficients") as caught:
        degree_of(count)
    assert str(caught.value) == f"{count} SH coefficients: expected 1, 4, 9, 16 or 25"


@pytest.mark.parametrize("degree", range(MAX_DEGREE + 1))
def test_rotated_coefficients_draw_the_old_colour_in_the_turned_direction(degree):
    generator = torch.Generator().manual_seed(degree)
    coefficients = torch.randn(
        6, num_coefficients(degree), 3, generator=generator, dtype=torch.float64
    )
    spin = torch.tensor([[0, -0.9, 0.4], [0.9, 0, 1.3], [-0.4, -1.3, 0]], dtype=torch.float64)
    rotation = torch.linalg.matrix_exp(spin)
    vectors = directions(20)
    before = torch.einsum("vk,nkd->nvd", sh_basis(degree, vectors), coefficients)
    turned = rotate_sh(coefficients, rotation)
    after = torch.einsum("vk,nkd->nvd", sh_basis(degree, vectors @ rotation.T), turned)
    torch.testing.assert_close(after, before, rtol=0, atol=1e-10)
