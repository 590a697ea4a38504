"""Tracks: where marked points of the built-in scene truly are at any time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float64, Int
from torch import Tensor

from gsfw.datamanagers.synthetic.scene import Solid


@dataclass(frozen=True)
class Tracks:
    """The paths of ``p`` points over ``t`` times."""

    positions: Float64[Tensor, "t p 3"]
    """In the frame that the function giving them states."""
    present: Bool[Tensor, "t p"]
    """True if the solid a point belongs to is there at that time."""


@dataclass(frozen=True)
class Marks:
    """Points that stick to solids and move with them."""

    solid: Int[Tensor, " p"]
    """Index of the solid."""
    own: Float64[Tensor, "p 3"]
    """Positions in the coordinates of that solid."""

    def tracks(self, solids: Sequence[Solid], times: Sequence[float]) -> Tracks:
        """The true paths, in the world of the built-in scene."""
        positions = torch.zeros(len(times), len(self.solid), 3, dtype=torch.float64)
        present = torch.zeros(len(times), len(self.solid), dtype=torch.bool)
        for row, time in enumerate(times):
            for index, solid in enumerate(solids):
                chosen = self.solid == index
                positions[row, chosen] = solid.motion(time).to_world(self.own[chosen].T).T
                present[row, chosen] = solid.is_present(time)
        return Tracks(positions, present)
