"""Merging: pairs of near, alike splats become one with the same moments.

A pair of masses m1 and m2 (opacity times area) becomes the Gaussian with the mean and covariance of
the two together, as in hierarchies of Gaussian mixtures (Goldberger and Roweis 2004; Kerbl et al.
2024, equations 4 and 5); its opacity keeps the mass.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.maths.frame import with_axes
from gsfw.core.maths.rotations import unit_matrices
from gsfw.core.operators import Operators
from gsfw.core.splats import Sh, Splats

NEIGHBORS = 8
"""Number of neighbours among which a splat finds its partner."""
COLOR = 2.0
"""Weight of a difference of constant coefficients, in sizes of the splats."""
MOST_OPAQUE = 0.999
"""Largest opacity of a merged splat."""
MOST_MERGED = 0.4
"""Largest part of the splats that one round of pairs removes: later pairs would be bad ones."""


def merged_down(splats: Splats, weights: Float[Tensor, " n"], count: int) -> Splats:
    """Merge pairs until ``count`` splats are left.

    Args:
        splats: float64, with quaternions, scales and SH colours.
        weights: importance of each splat, such as its contribution to views.
        count: number of splats that are left, at least 1.
    """
    while len(splats) > count:
        most = max(1, min(len(splats) - count, int(MOST_MERGED * len(splats))))
        first, second = _pairs(splats, weights, most)
        left = torch.ones(len(splats), dtype=torch.bool)
        left[first], left[second] = False, False
        parents = _merged(splats, first, second)
        rest = splats.take(left.nonzero()[:, 0])
        splats = Splats.cat([rest, parents])
        weights = torch.cat([weights[left], weights[first] + weights[second]])
    return splats


def _pairs(
    splats: Splats, weights: Float[Tensor, " n"], most: int
) -> tuple[Int[Tensor, " p"], Int[Tensor, " p"]]:
    """Disjoint pairs of neighbours, the cheapest first; at least one."""
    assert splats.scales is not None
    assert isinstance(splats.colors, Sh)
    count = len(splats)
    neighbors = Operators().neighbors(splats.means.float(), min(NEIGHBORS, count - 1))
    one = torch.arange(count)[:, None].expand_as(neighbors).flatten()
    other = neighbors.flatten()
    sizes = splats.scales.amax(1)
    apart = (splats.means[one] - splats.means[other]).square().sum(1)
    constants = splats.colors.coefficients[:, 0].double()
    unlike = (constants[one] - constants[other]).square().sum(1)
    nearness = apart / (sizes[one] * sizes[other]).clamp_min(1e-30) + COLOR**2 * unlike
    masses = weights[one] * weights[other] / (weights[one] + weights[other]).clamp_min(1e-30)
    order = ((masses + 1e-6) * nearness).where(one != other, torch.inf).argsort()
    return _disjoint(one[order], other[order], count, most)


def _disjoint(
    one: Int[Tensor, " e"], other: Int[Tensor, " e"], count: int, most: int
) -> tuple[Int[Tensor, " p"], Int[Tensor, " p"]]:
    """Pairs that are each the best one left for both of their splats, round by round."""
    free = torch.ones(count, dtype=torch.bool)
    chosen: list[Tensor] = []
    found = 0
    places = torch.arange(len(one))
    while found < most:
        open_edges = free[one[places]] & free[other[places]] & (one[places] != other[places])
        places = places[open_edges]
        if not len(places):
            break
        best = torch.full((count,), len(one))
        best.scatter_reduce_(0, one[places], places, "amin")
        best.scatter_reduce_(0, other[places], places, "amin")
        both = (best[one[places]] == places) & (best[other[places]] == places)
        new = places[both][: most - found]
        free[one[new]], free[other[new]] = False, False
        chosen.append(new)
        found += len(new)
    picked = torch.cat(chosen)
    return one[picked], other[picked]


def _merged(splats: Splats, first: Int[Tensor, " p"], second: Int[Tensor, " p"]) -> Splats:
    """One splat with the moments of each pair."""
    one, other = splats.take(first), splats.take(second)
    assert isinstance(one.colors, Sh)
    assert isinstance(other.colors, Sh)
    masses = torch.stack([_masses(one), _masses(other)])
    shares = masses / masses.sum(0).clamp_min(1e-300)
    shares = shares.where(masses.sum(0) > 0, 0.5)
    means = shares[0, :, None] * one.means + shares[1, :, None] * other.means
    parts = [
        share[:, None, None] * (_covariances(side) + _outer(side.means - means))
        for share, side in zip(shares, (one, other), strict=True)
    ]
    weights = shares.to(one.colors.coefficients)[:, :, None, None]
    colors = weights[0] * one.colors.dense() + weights[1] * other.colors.dense()
    placed = replace(
        one, means=means, covariances=parts[0] + parts[1], quats=None, scales=None,
        colors=Sh(colors, one.colors.degree), extra=None, rows=None,
    )  # fmt: skip
    merged = with_axes(placed)
    opacities = masses.sum(0) / _areas(merged).clamp_min(1e-300)
    highest = torch.maximum(one.opacities, other.opacities).clamp_min(MOST_OPAQUE)
    return replace(merged, opacities=torch.minimum(opacities, highest))


def _areas(splats: Splats) -> Float[Tensor, " n"]:
    """Product of the two longest axes."""
    assert splats.scales is not None
    return splats.scales.sort(dim=1).values[:, 1:].prod(1)


def _masses(splats: Splats) -> Float[Tensor, " n"]:
    return splats.opacities * _areas(splats)


def _covariances(splats: Splats) -> Float[Tensor, "n 3 3"]:
    assert splats.quats is not None
    assert splats.scales is not None
    quats = splats.quats / splats.quats.norm(dim=1, keepdim=True).clamp_min(1e-12)
    sides = unit_matrices(quats) * splats.scales[:, None, :]
    return sides @ sides.transpose(1, 2)


def _outer(offsets: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3 3"]:
    return offsets[:, :, None] * offsets[:, None, :]
