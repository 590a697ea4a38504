"""New rows: children of a divided model, each in the process that has its parent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Int
from torch import Tensor

from gsfw.core.column import Column, Rows
from gsfw.core.model import Children


@dataclass(frozen=True, eq=False)
class NewRows(Mapping[str, Rows]):
    """The part of ``count`` new rows that this process has made.

    Refiners hand them from the model to the table, which brings each to its place.
    """

    count: int
    """Number of new rows of all processes."""
    places: Int[Tensor, " r"]
    """The places of these among them."""
    rows: Children

    def __getitem__(self, name: str) -> Rows:
        return self.rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    def after(self, first: NewRows, columns: Mapping[str, Column]) -> NewRows:
        """The rows of ``first``, then these."""
        places = torch.cat([first.places, first.count + self.places])
        return NewRows(first.count + self.count, places, joined([first.rows, self.rows], columns))


def joined(parts: list[Children], columns: Mapping[str, Column]) -> Children:
    """The rows of several sets, one after the other."""
    found = parts[0]
    for part in parts[1:]:
        found = {name: column.join(found[name], part[name]) for name, column in columns.items()}
    return found
