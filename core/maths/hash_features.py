"""Features of a multi-resolution hash grid in place and time, in plain torch.

Mueller et al. 2022, "Instant Neural Graphics Primitives with a Multiresolution Hash Encoding",
section 3, in four dimensions: corners of cells share the rows of a table by a hash (equation 4)
unless there is a row for each, and rows are interpolated linearly.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.maths.interpolation import corners, weighted_rows

PRIMES = (1, 2_654_435_761, 805_459_861, 3_674_653_429)
"""Factors of the hash: those of equation 4 for x, y and z, and a fourth of the released code."""


def hash_features(
    places: Float[Tensor, "n 3"],
    time: Float[Tensor, ""],
    table: Float[Tensor, "m d"],
    sizes: tuple[int, int],
) -> Float[Tensor, "n d"]:
    """Interpolate among the 16 corners around each place, at one resolution.

    Args:
        places: coordinates in [-1, 1]; constant beyond, without gradient. NaN reads some row.
        time: time in [0, 1]; constant beyond.
        table: rows of features; a power of two of them unless there is a row for each corner.
        sizes: corners along each axis of space, and along time; at least 2.
    """
    axes = [*((places.detach().T.clamp(-1, 1) + 1) / 2), time.to(places).clamp(0, 1).view(1)]
    counts = [sizes[0]] * 3 + [sizes[1]]
    dense = math.prod(counts) <= len(table)
    factors = strides(counts) if dense else PRIMES
    rows, weights = [], []
    for axis, count, factor in zip(axes, counts, factors, strict=True):
        place = axis * (count - 1)
        low = place.floor().nan_to_num().clamp_max(count - 2)
        first = low.long() * factor
        rows.append((first, first + factor))
        weights.append((1 - (place - low), place - low))
    chosen = corners(rows, torch.add if dense else torch.bitwise_xor)
    if not dense:
        chosen = chosen & (len(table) - 1)
    return weighted_rows(table, chosen.int(), corners(weights, torch.mul))


def strides(counts: list[int]) -> tuple[int, ...]:
    """Distance in rows between neighbours along each axis, the first axis changing fastest."""
    return tuple(math.prod(counts[:axis]) for axis in range(len(counts)))
