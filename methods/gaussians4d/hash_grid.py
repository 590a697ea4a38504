"""Encoder hash: a multi-resolution hash grid in place and time.

Mueller et al. 2022, "Instant Neural Graphics Primitives with a Multiresolution Hash Encoding",
section 3, in four dimensions: resolutions grow geometrically (equations 2 and 3), corners of cells
share the rows of a table by a hash (equation 4) unless there is a row for each, and rows are
interpolated linearly. Time has cells of its own: no more than captured times, so that the field
interpolates between two captured times. Positions are detached, as in Yang et al. 2024.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor, nn

from gsfw.core.operators import Operators
from gsfw.methods.gaussians4d.encoder import Encoder
from gsfw.methods.gaussians4d.layers import uniform

if TYPE_CHECKING:
    from gsfw.methods.gaussians4d.config import HashConfig

START = 1e-4
"""Rows are initialised between minus and plus this (section 4 of the paper)."""


class HashGrid(Encoder):
    """Rows of tables, one table per resolution."""

    detached = True

    def __init__(
        self, config: HashConfig, times: int, operators: Operators, generator: torch.Generator
    ) -> None:
        """Initialise the tables at random.

        Args:
            config: sizes.
            times: most corners of cells along time, the first at time 0 and the last at time 1.
            operators: for the features.
            generator: generator on the CPU.
        """
        super().__init__()
        self._operators = operators
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
        return self._operators.hash_features(places, time, [*self.tables], self._sizes)
