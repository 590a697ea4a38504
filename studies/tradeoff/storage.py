"""Storage: stored bytes of a moving model by row, and the effect of edits on them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Int
from torch import Tensor

from gsfw.core.column import Column
from gsfw.core.maths.spherical_harmonics import num_coefficients
from gsfw.core.model import PrimitiveModel
from gsfw.studies.requirements.census import is_bands, is_drawn


@dataclass(frozen=True)
class Storage:
    """Bytes that are needed to render a model, row by row."""

    rows: Mapping[str, Int[Tensor, " n"]]
    """Bytes of each row by name of the column; 0 in all columns for a removed row."""
    temporal: frozenset[str]
    """Names of columns that describe only the change of rows over time."""
    coefficients: Mapping[str, int]
    """Bytes of one SH coefficient, for each column of coefficients above the constant one."""
    shared: int
    """Bytes of networks and grids, which belong to no row."""

    @staticmethod
    def of(model: PrimitiveModel) -> Storage:
        """Everything but the data that only training needs."""
        temporal = frozenset(model.temporal_columns())
        columns = {
            name: column
            for name, column in model.columns().items()
            if is_drawn(column, name in temporal)
        }
        return Storage(
            rows={name: _row_bytes(column) for name, column in columns.items()},
            temporal=temporal,
            coefficients={
                name: column.values.shape[-1] * column.values.element_size()
                for name, column in columns.items()
                if is_bands(name, column)
            },
            shared=sum(
                tensor.nbytes for group in model.parameter_groups() for tensor in group.parameters
            ),
        )

    @property
    def num_bytes(self) -> int:
        """Bytes of everything."""
        return self.shared + sum(int(column.sum()) for column in self.rows.values())

    @property
    def num_rows(self) -> int:
        """Number of rows with any bytes."""
        return int(torch.stack(list(self.rows.values())).any(0).sum())

    def of_rows(self, kept: Int[Tensor, " m"]) -> Storage:
        """The storage of these rows alone."""
        left = {
            name: torch.zeros_like(column).index_copy(0, kept, column[kept])
            for name, column in self.rows.items()
        }
        return replace(self, rows=left)

    def up_to_degree(self, degree: int) -> Storage:
        """The storage without the SH coefficients of the bands above ``degree``."""
        count = num_coefficients(degree) - 1
        left = {
            name: self.rows[name].clamp_max(count * each)
            for name, each in self.coefficients.items()
        }
        return replace(self, rows={**self.rows, **left})

    def without_time(self, rows: Int[Tensor, " m"]) -> Storage:
        """The storage without the time parameters of these rows.

        A model without such columns moves its rows by shared parameters, which go with the last
        moving row.
        """
        left = {name: self.rows[name].index_fill(0, rows, 0) for name in self.temporal}
        everything = len(rows) == len(next(iter(self.rows.values())))
        shared = 0 if everything and not self.temporal else self.shared
        return replace(self, rows={**self.rows, **left}, shared=shared)


class Cut(ABC):
    """An edit of splats that reduces the storage of a moving model, too.

    Other edits of splats change their rendering only.
    """

    @abstractmethod
    def left_of(self, storage: Storage) -> Storage:
        """The storage after the edit."""


def _row_bytes(column: Column) -> Int[Tensor, " n"]:
    """Bytes of each row of a column."""
    if column.offsets is None:
        each = column.values.nbytes // max(column.num_rows, 1)
        return torch.full((column.num_rows,), each, device=column.values.device)
    each = column.values.shape[1:].numel() * column.values.element_size()
    return column.offsets.diff() * each
