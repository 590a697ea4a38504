"""Rigidity: losses of the relative motion of neighbours from one time to the next.

Luiten et al. 2024, equations 5 to 8. For row i and its neighbour j, with the rotation
q~_i = q_i,t conj(q_i,t-1) since the previous time and R_i its matrix:

    rigid     mean sqrt(w_ij |(x_j - x_i) - R_i (x_j,t-1 - x_i,t-1)|^2)
    rotation  mean sqrt(w_ij |q~_j - q~_i|^2)
    isometry  mean sqrt(w_ij (|x_j - x_i| - |x_j,0 - x_i,0|)^2)

The paper has R_i^T on the other side of the first, which is the same length.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from gsfw.core.maths.rotations import relative_quaternions, same_half, unit_matrices

TINY = 1e-20
"""Added under square roots, as in the released code: at zero their derivative is not finite."""


@dataclass(frozen=True)
class Neighbors:
    """Some neighbours of every row, and their earlier poses."""

    rows: Int[Tensor, "n k"]
    weights: Float[Tensor, "n k"]
    """Weights in [0, 1]."""
    previous: Float[Tensor, "n k 3"]
    """Vectors from each row to its neighbour at the previous time."""
    lengths: Float[Tensor, "n k"]
    """Distances at the first time."""


def rigidity(
    neighbors: Neighbors,
    means: Float[Tensor, "n 3"],
    quats: Float[Tensor, "n 4"],
    previous_quats: Float[Tensor, "n 4"],
) -> tuple[Float[Tensor, ""], Float[Tensor, ""], Float[Tensor, ""]]:
    """The rigid, rotation and isometry terms; lengths in scene units.

    Args:
        neighbors: neighbours of every row.
        means: current positions.
        quats: current quaternions, of any norm.
        previous_quats: quaternions at the previous time, of norm 1.
    """
    quats = normalize(quats, dim=1)
    turned = relative_quaternions(same_half(quats, previous_quats), previous_quats)
    offsets = _differences(means, neighbors.rows)
    expected = torch.bmm(neighbors.previous, unit_matrices(turned).transpose(1, 2))
    stretched = (offsets.square().sum(2) + TINY).sqrt() - neighbors.lengths
    return (
        _mean(neighbors.weights * (offsets - expected).square().sum(2)),
        _mean(neighbors.weights * _differences(turned, neighbors.rows).square().sum(2)),
        _mean(neighbors.weights * stretched.square()),
    )


def _differences(values: Float[Tensor, "n d"], rows: Int[Tensor, "n k"]) -> Float[Tensor, "n k d"]:
    """Differences from each row's value to those of its neighbours."""
    return values.index_select(0, rows.flatten()).view(*rows.shape, -1) - values[:, None]


def _mean(squares: Float[Tensor, "n k"]) -> Float[Tensor, ""]:
    return (squares + TINY).sqrt().mean()
