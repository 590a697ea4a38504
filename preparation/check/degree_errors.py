"""Degree errors: how well spherical harmonics of each degree foretell the colours of points.

Every colour is foretold from all others of its point by least squares over the directions it is
seen from, which takes no second fit: leaving one out makes its residual r to r / (1 - leverage)
(Allen 1974, "The Relationship between Variable Selection and Data Augmentation and a Method for
Prediction"). More coefficients therefore gain nothing by themselves.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.maths.spherical_harmonics import num_coefficients, sh_basis

DEGREES = (0, 1, 2)
"""Degree 3 has more coefficients than most points have pictures."""
ALONE = 0.98
"""Leverage from which on an observation decides a coefficient alone, and cannot be foretold."""
RANK = 1e-6
"""Directions span as many functions as the Gram matrix has eigenvalues above this part of the
largest: cameras on a circle around a point tell only 5 of 9 apart."""


def degree_errors(
    points: Int[Tensor, " o"], directions: Float[Tensor, "o 3"], values: Float[Tensor, "o 3"]
) -> Float[Tensor, "p 3"]:
    """Mean square error of every degree at every point.

    It is infinite where a point has too few observations for a degree.

    Args:
        points: of each observation; every number from 0 on is there.
        directions: unit vectors.
        values: colours.
    """
    basis = sh_basis(max(DEGREES), directions)
    fits = [basis[:, : num_coefficients(degree)] for degree in DEGREES]
    return torch.stack([_errors(points, fit, values) for fit in fits], dim=1)


def point_means(
    points: Int[Tensor, " o"], values: Float[Tensor, "o ..."]
) -> Float[Tensor, "p ..."]:
    """Means over the observations of each point."""
    counts = torch.bincount(points)
    sums = values.new_zeros(len(counts), *values.shape[1:]).index_add(0, points, values)
    return sums / counts.view(-1, *(1 for _ in values.shape[1:]))


def _errors(
    points: Int[Tensor, " o"], basis: Float[Tensor, "o k"], values: Float[Tensor, "o 3"]
) -> Float[Tensor, " p"]:
    """Of one degree."""
    gram = point_means(points, basis[:, :, None] * basis[:, None])
    inverse = torch.linalg.pinv(gram, rtol=RANK, hermitian=True)
    coefficients = inverse @ point_means(points, basis[:, :, None] * values[:, None])
    fitted = torch.einsum("ok,okd->od", basis, coefficients[points])
    leverage = torch.einsum("ok,okl,ol->o", basis, inverse[points], basis)
    leverage = leverage / torch.bincount(points)[points]
    errors = ((values - fitted) / (1.0 - leverage)[:, None]).square().mean(1)
    return point_means(points, errors.where(leverage < ALONE, torch.inf))
