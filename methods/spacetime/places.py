"""Places: the rows of the values of a ragged column."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor


@dataclass(frozen=True)
class Places:
    """Row of each value of a ragged column, and its index among that row's values."""

    rows: Int[Tensor, " m"]
    within: Int[Tensor, " m"]

    @staticmethod
    def of(lengths: Int[Tensor, " n"]) -> Places:
        """Compute the places of rows with so many values each."""
        rows = torch.arange(len(lengths), device=lengths.device).repeat_interleave(lengths)
        starts = lengths.cumsum(0) - lengths
        return Places(rows, torch.arange(len(rows), device=lengths.device) - starts[rows])

    def padded(self, values: Float[Tensor, "m d"], count: int, width: int) -> Tensor:
        """The values as [count, width, d], padded with zeros."""
        dense = values.new_zeros(count, width, values.shape[1])
        dense[self.rows, self.within] = values
        return dense

    def packed(self, dense: Float[Tensor, "n k d"]) -> Float[Tensor, "m d"]:
        """Remove the padding: the values of the rows."""
        return dense[self.rows, self.within]
