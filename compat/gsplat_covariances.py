"""Covariances of splats, which gsplat's ``MCMCStrategy`` shapes its noise with."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.api import rotation_matrices

UPPER = torch.triu_indices(3, 3)
"""Rows and columns of xx, xy, xz, yy, yz, zz."""


def quat_scale_to_covar_preci(
    quats: Float[Tensor, "n 4"],
    scales: Float[Tensor, "n 3"],
    compute_covar: bool = True,
    compute_preci: bool = True,
    triu: bool = False,
) -> tuple[Tensor | None, Tensor | None]:
    """Covariances R S S R^T and their inverses, [n, 3, 3], or with ``triu`` their upper halves.

    Args:
        quats: rotations wxyz, of any length but 0.
        scales: standard deviations, in scene units.
        compute_covar: False for ``None`` in the place of the covariances.
        compute_preci: False for ``None`` in the place of the inverses.
        triu: return [n, 6]: upper halves, row by row.
    """
    rotations = rotation_matrices(quats)
    return (
        _squared(rotations * scales[:, None], triu) if compute_covar else None,
        _squared(rotations / scales[:, None], triu) if compute_preci else None,
    )


def _squared(axes: Float[Tensor, "n 3 3"], triu: bool) -> Tensor:
    """A A^T, or its upper half."""
    whole = axes @ axes.transpose(1, 2)
    return whole[:, UPPER[0], UPPER[1]] if triu else whole
