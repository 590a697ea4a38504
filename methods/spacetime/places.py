"""Places: where the values of ragged rows belong."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor


@dataclass(frozen=True)
class Places:
    """The row of each value of a ragged column, and which of that row's values it is."""

    rows: Int[Tensor, " m"]
    within: Int[Tensor, " m"]

    @staticmethod
    def of(lengths: Int[Tensor, " n"]) -> Places:
        """Of rows with so many values each."""
        rows = torch.arange(len(lengths), device=lengths.device).repeat_interleave(lengths)
        starts = lengths.cumsum(0) - lengths
        return Places(rows, torch.arange(len(rows), device=lengths.device) - starts[rows])

    def padded(self, values: Float[Tensor, "m d"], count: int, width: int) -> Tensor:
        """The values as [count, width, d], with zeros where a row has no more."""
        dense = values.new_zeros(count, width, values.shape[1])
        dense[self.rows, self.within] = values
        return dense

    def packed(self, dense: Float[Tensor, "n k d"]) -> Float[Tensor, "m d"]:
        """Those of padded values that the rows have."""
        return dense[self.rows, self.within]
