"""Merging: pairs of near, alike splats become one with the same moments.

A pair becomes the Gaussian with the moments of the two together (``core.maths.moments``); its
opacity keeps the mass.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.maths.moments import Moments
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
    one, other = Moments.of(splats.take(first)), Moments.of(splats.take(second))
    return Moments.joined(one, other).splats(MOST_OPAQUE)
