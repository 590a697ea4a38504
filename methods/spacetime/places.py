"""Places: the rows of the values of a ragged column."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.maths.ragged import value_indices, value_rows


@dataclass(frozen=True)
class Places:
    """Row of each value of a ragged column, and its index among that row's values."""

    rows: Int[Tensor, " m"]
    within: Int[Tensor, " m"]

    @staticmethod
    def of(lengths: Int[Tensor, " n"]) -> Places:
        """Compute the places of rows with so many values each."""
        return Places(value_rows(lengths), value_indices(torch.zeros_like(lengths), lengths))

    def padded(self, values: Float[Tensor, "m d"], count: int, width: int) -> Tensor:
        """The values as [count, width, d], padded with zeros."""
        dense = values.new_zeros(count, width, values.shape[1])
        dense[self.rows, self.within] = values
        return dense

    def packed(self, dense: Float[Tensor, "n k d"]) -> Float[Tensor, "m d"]:
        """Remove the padding: the values of the rows."""
        return dense[self.rows, self.within]
