"""NeighborGraph: the nearest rows of each row, recomputed at intervals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from gsfw.core.operators import Operators


class NeighborGraph(nn.Module):
    """The ``count`` nearest rows of each row.

    It is part of the state, since a resumed run must continue with the same neighbours. After an
    equal number of rows were replaced it is stale until its next refresh, which is harmless.
    """

    rows: Tensor

    def __init__(self, count: int, refresh_every: int) -> None:
        super().__init__()
        self._count, self._refresh_every = count, refresh_every
        self.register_buffer("rows", torch.zeros(0, count, dtype=torch.int64))

    def is_due(self, step: int, count: int) -> bool:
        """True at intervals of steps, and if the number of rows has changed."""
        return len(self.rows) != count or step % self._refresh_every == 0

    def refresh_(self, points: Float[Tensor, "n d"], operators: Operators) -> None:
        """Recompute the graph; in place if it has as many rows, since recorded steps read it."""
        found = operators.neighbors(points, self._count)
        if found.shape == self.rows.shape:
            self.rows.copy_(found)
        else:
            self.rows = found

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
        """Accept any number of rows: a checkpoint keeps its own row count."""
        rows = state_dict.get(prefix + "rows")
        if rows is not None:
            self.rows = rows.to(self.rows.device).clone()
        super()._load_from_state_dict(state_dict, prefix, *args)
