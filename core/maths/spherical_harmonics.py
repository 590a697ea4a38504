"""Real spherical harmonics up to degree 4, in the sign convention of 3DGS.

Kerbl et al. 2023; the basis is that of Sloan, "Efficient Spherical Harmonic Evaluation", 2013, with
the Condon-Shortley signs kept: band 1 is (-y, z, -x).
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

C0 = 0.28209479177387814
"""1 / (2 sqrt(pi)): the constant band, which ties a colour to its first coefficient."""

MAX_DEGREE = 4


def num_coefficients(degree: int) -> int:
    """Total number of coefficients of degrees 0 to ``degree``."""
    return (degree + 1) ** 2


def degree_of(coefficients: int) -> int:
    """The degree with this number of coefficients.

    Raises:
        ValueError: no degree from 0 to 4 has this number.
    """
    for degree in range(MAX_DEGREE + 1):
        if num_coefficients(degree) == coefficients:
            return degree
    raise ValueError(f"{coefficients} SH coefficients: expected 1, 4, 9, 16 or 25")


def rgb_to_dc(rgb: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
    """The constant coefficient of a colour that is the same from every direction."""
    return (rgb - 0.5) / C0


def dc_to_rgb(dc: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
    """The colour of a constant coefficient, before the clamp at 0."""
    return dc * C0 + 0.5


def sh_basis(degree: int, directions: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b k"]:
    """The basis functions in unit ``directions``; k = (degree + 1) squared."""
    x, y, z = directions.unbind(-1)
    basis = [torch.full_like(x, C0)]
    if degree >= 1:
        basis += [-0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x]
    if degree >= 2:
        xx, yy, zz = x * x, y * y, z * z
        basis += [
            1.0925484305920792 * x * y,
            -1.0925484305920792 * y * z,
            0.31539156525252005 * (2 * zz - xx - yy),
            -1.0925484305920792 * x * z,
            0.5462742152960396 * (xx - yy),
        ]
    if degree >= 3:
        basis += [
            -0.5900435899266435 * y * (3 * xx - yy),
            2.890611442640554 * x * y * z,
            -0.4570457994644658 * y * (4 * zz - xx - yy),
            0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
            -0.4570457994644658 * x * (4 * zz - xx - yy),
            1.445305721320277 * z * (xx - yy),
            -0.5900435899266435 * x * (xx - 3 * yy),
        ]
    if degree >= 4:
        basis += [
            2.5033429417967046 * x * y * (xx - yy),
            -1.7701307697799304 * y * z * (3 * xx - yy),
            0.9461746957575601 * x * y * (7 * zz - 1),
            -0.6690465435572892 * y * z * (7 * zz - 3),
            0.10578554691520431 * (zz * (35 * zz - 30) + 3),
            -0.6690465435572892 * x * z * (7 * zz - 3),
            0.47308734787878004 * (xx - yy) * (7 * zz - 1),
            -1.7701307697799304 * x * z * (xx - 3 * yy),
            0.6258357354491761 * (xx * (xx - 3 * yy) - yy * (3 * xx - yy)),
        ]
    return torch.stack(basis, dim=-1)


def rotate_sh(
    coefficients: Float[Tensor, "n k 3"], rotation: Float[Tensor, "3 3"]
) -> Float[Tensor, "n k 3"]:
    """The coefficients of the same colours after a rotation of the world.

    A band is mapped to itself: f'(R d) = f(d) for all d. The matrix of each band is computed from
    the basis in more directions than it has functions, which is exact up to rounding.
    """
    degree = degree_of(coefficients.shape[1])
    generator = torch.Generator().manual_seed(0)
    directions = torch.randn(64, 3, generator=generator, dtype=torch.float64)
    directions = directions / directions.norm(dim=1, keepdim=True)
    before = sh_basis(degree, directions)
    after = sh_basis(degree, directions @ rotation.double().cpu().T)
    turned = coefficients.clone()
    for band in range(1, degree + 1):
        columns = slice(band * band, (band + 1) ** 2)
        matrix = torch.linalg.lstsq(after[:, columns], before[:, columns]).solution
        turned[:, columns] = torch.einsum(
            "jk,nkd->njd", matrix.to(coefficients), coefficients[:, columns]
        )
    return turned


def mirror_signs(degree: int, signs: tuple[float, float, float]) -> Float[Tensor, " k"]:
    """The signs by which mirrored axes multiply the coefficients; k = (degree + 1) squared.

    Each basis function is even or odd in each coordinate, so that f'(S d) = f(d), with S the
    diagonal matrix of ``signs``, needs no more than a sign for each coefficient.
    """
    direction = torch.tensor([0.36, 0.48, 0.8], dtype=torch.float64)
    before, after = sh_basis(degree, direction), sh_basis(degree, direction * torch.tensor(signs))
    return (before * after).sign()
