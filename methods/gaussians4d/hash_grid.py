"""Encoder hash: a multi-resolution hash grid in place and time, in plain torch.

Mueller et al. 2022, "Instant Neural Graphics Primitives with a Multiresolution Hash Encoding",
section 3, in four dimensions: resolutions grow geometrically (equations 2 and 3), corners of cells
share the rows of a table by a hash (equation 4) unless there is a row for each, and rows are
interpolated linearly. Time has cells of its own: no more than captured times, so that the field
interpolates between two captured times. Positions are detached, as in Yang et al. 2024.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor, nn

from gsfw.core.maths.interpolation import corners, weighted_rows
from gsfw.methods.gaussians4d.encoder import Encoder
from gsfw.methods.gaussians4d.layers import uniform

if TYPE_CHECKING:
    from gsfw.methods.gaussians4d.config import HashConfig

PRIMES = (1, 2_654_435_761, 805_459_861, 3_674_653_429)
"""Factors of the hash: those of equation 4 for x, y and z, and a fourth of the released code."""
START = 1e-4
"""Rows are initialised between minus and plus this (section 4 of the paper)."""


class HashGrid(Encoder):
    """Rows of tables, one table per resolution."""

    detached = True

    def __init__(self, config: HashConfig, times: int, generator: torch.Generator) -> None:
        """Initialise the tables at random.

        Args:
            config: sizes.
            times: most corners of cells along time, the first at time 0 and the last at time 1.
            generator: generator on the CPU.
        """
        super().__init__()
        self.features = config.levels * config.features
        growth = (config.finest / config.coarsest) ** (1 / max(config.levels - 1, 1))
        self._sizes: list[tuple[int, int]] = []
        tables = []
        for level in range(config.levels):
            cells = round(config.coarsest * growth**level)
            self._sizes.append((cells + 1, min(cells + 1, times)))
            rows = min((cells + 1) ** 3 * self._sizes[-1][1], 2**config.log2_rows)
            tables.append(uniform((rows, config.features), -START, START, generator))
        self.tables = nn.ParameterList(tables)

    def grids(self) -> tuple[nn.Parameter, ...]:
        """The tables [m, d], coarsest first."""
        return tuple(self.tables)

    def forward(
        self, places: Float[Tensor, "n 3"], time: Float[Tensor, ""]
    ) -> Float[Tensor, "n f"]:
        """Interpolated rows of every resolution."""
        axes = [*((places.detach().T.clamp(-1, 1) + 1) / 2), time.to(places).clamp(0, 1).view(1)]
        levels = zip(self.tables, self._sizes, strict=True)
        features = [_level(table, sizes, axes) for table, sizes in levels]
        return torch.cat(features, dim=1)


def _level(
    table: Float[Tensor, "m d"], sizes: tuple[int, int], axes: list[Tensor]
) -> Float[Tensor, "n d"]:
    """Interpolate among the 16 corners around each place, at one resolution.

    Args:
        table: rows of features.
        sizes: corners along each axis of space, and along time.
        axes: x, y and z [n], and time [1], in [0, 1].
    """
    counts = [sizes[0]] * 3 + [sizes[1]]
    dense = math.prod(counts) <= len(table)
    factors = _strides(counts) if dense else PRIMES
    rows, weights = [], []
    for axis, count, factor in zip(axes, counts, factors, strict=True):
        place = axis * (count - 1)
        low = place.floor().clamp_max(count - 2)
        first = low.long() * factor
        rows.append((first, first + factor))
        weights.append((1 - (place - low), place - low))
    chosen = corners(rows, torch.add if dense else torch.bitwise_xor)
    if not dense:
        chosen = chosen & (len(table) - 1)
    return weighted_rows(table, chosen.int(), corners(weights, torch.mul))


def _strides(counts: list[int]) -> tuple[int, ...]:
    """Distance in rows between neighbours along each axis, the first axis changing fastest."""
    return tuple(math.prod(counts[:axis]) for axis in range(len(counts)))
