"""NeighborGraph: which rows lie nearest to each row, worked out anew now and then."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from gsfw.core.operators import Operators


class NeighborGraph(nn.Module):
    """The ``count`` nearest rows of each row.

    It is part of the state, since a resumed run must go on with the same neighbours. After rows
    were replaced by as many others it is out of date until it is refreshed, which does no harm.
    """

    rows: Tensor

    def __init__(self, count: int, refresh_every: int) -> None:
        super().__init__()
        self._count, self._refresh_every = count, refresh_every
        self.register_buffer("rows", torch.zeros(0, count, dtype=torch.int64))

    def refresh_(self, step: int, points: Float[Tensor, "n d"], operators: Operators) -> None:
        """Work it out anew if it is time to, or if the number of rows has changed."""
        if len(self.rows) != len(points) or step % self._refresh_every == 0:
            self.rows = operators.neighbors(points, self._count)

    def mean(self, values: Float[Tensor, "n d"], rows: Int[Tensor, " r"]) -> Float[Tensor, "r d"]:
        """Mean over the neighbours of ``rows``."""
        chosen = self.rows.index_select(0, rows)
        found = values.index_select(0, chosen.flatten())
        return found.view(*chosen.shape, values.shape[1]).mean(1)

    def _load_from_state_dict(
        self,
        state_dict: Mapping[str, Any],
        prefix: str,
        *args: Any,  # noqa: ANN401
    ) -> None:
        """Accept any number of rows: a checkpoint has the count it was written with."""
        rows = state_dict.get(prefix + "rows")
        if rows is not None:
            self.rows = rows.to(self.rows.device).clone()
        super()._load_from_state_dict(state_dict, prefix, *args)
