"""SplatTable: the only code that keeps, appends or replaces rows."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from jaxtyping import Bool, Int
from torch import Tensor

from gsfw.core.column import Column, Rows
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.model import Children, PrimitiveModel
from gsfw.core.operators import AdamMoments


class SplatTable:
    """A model's columns and their optimizer moments, edited together; failed edits change nothing.

    ``Children``, the new rows of an edit, map the name of every column to ``Rows``.

    Every edit is computed in full before anything changes, so that an error (out of memory,
    wrong shapes) leaves model and optimizer unchanged. Kept rows keep their moments;
    the moments of new and replaced rows start at zero.
    """

    def __init__(self, model: PrimitiveModel, optimizer: Optimizer) -> None:
        self._model = model
        self._optimizer = optimizer
        self.row_edits = 0
        """Number of edits that added, removed or replaced rows; each makes row statistics stale."""

    def __len__(self) -> int:
        return self._model.num_rows

    @property
    def device(self) -> torch.device:
        """Device of the rows."""
        return next(iter(self._model.columns().values())).values.device

    def learning_rate(self, name: str, step: int) -> float:
        """Learning rate of a column at ``step``, counted from 0."""
        return self._optimizer.learning_rates(step)[name]

    def keep(self, rows: Bool[Tensor, " n"] | Int[Tensor, " r"]) -> None:
        """Keep these rows (a mask, or indices in the new order) and drop all others."""
        self.edit(rows, None)

    def append(self, children: Children) -> None:
        """Add rows at the end.

        Raises:
            ValueError: ``children`` does not have exactly the model's columns, or not the same
                number of rows in each.
        """
        self.edit(None, children)

    @torch.no_grad()
    def edit(
        self, keep: Bool[Tensor, " n"] | Int[Tensor, " r"] | None, children: Children | None
    ) -> None:
        """Keep some rows (all if ``None``), then add ``children`` (none if ``None``).

        Raises:
            ValueError: as ``append``, or the mask does not have one value per row.
        """
        columns = self._model.columns()
        if children is not None:
            self._check(children)
        if keep is None:
            keep = torch.arange(len(self), device=self.device)
        if keep.dtype == torch.bool and len(keep) != len(self):
            raise ValueError(f"a mask of {len(keep)} rows for {len(self)}")
        rows = keep.nonzero()[:, 0] if keep.dtype == torch.bool else keep
        values: dict[str, Rows] = {}
        moments: dict[str, list[AdamMoments]] = {}
        for name, column in columns.items():
            new = None if children is None else children[name]
            values[name] = self._edited(column, column.values, rows, new)
            if column.trained:
                fresh = None if new is None else Rows.zeros_like(new)
                moments[name] = [
                    AdamMoments(
                        self._edited(column, state.first, rows, fresh).values,
                        self._edited(column, state.second, rows, fresh).values,
                        state.count,
                    )
                    for state in self._optimizer.moments(name)
                ]
        for name, column in columns.items():
            column.assign(values[name])
            if column.trained:
                self._optimizer.replace_moments(name, moments[name])
        self.row_edits += 1

    def joined(self, first: Children, second: Children) -> Children:
        """Concatenate the new rows of ``first`` and of ``second``."""
        columns = self._model.columns()
        return {name: column.join(first[name], second[name]) for name, column in columns.items()}

    @staticmethod
    def _edited(column: Column, values: Tensor, rows: Tensor, new: Rows | None) -> Rows:
        kept = column.take(rows, values)
        return kept if new is None else column.join(kept, new)

    @torch.no_grad()
    def replace(self, rows: Int[Tensor, " r"], children: Children) -> None:
        """Overwrite rows in place; their moments restart at zero."""
        columns = self._model.columns()
        self._check(children, len(rows))
        for name, column in columns.items():
            column.check_lengths(rows, children[name])
        for name, column in columns.items():
            column.write(rows, children[name])
        self.reset_rows(rows)
        self.row_edits += 1

    @torch.no_grad()
    def resize(self, name: str, lengths: Int[Tensor, " n"]) -> None:
        """Change the number of values of the rows of a ragged column (added or removed SH bands).

        Remaining values and moments are kept; new ones start at zero.

        Raises:
            ValueError: the column is not ragged, or ``lengths`` has another number of rows.
        """
        column = self._model.columns()[name]
        values = column.resized(lengths)
        moments = [
            AdamMoments(
                column.resized(lengths, state.first).values,
                column.resized(lengths, state.second).values,
                state.count,
            )
            for state in (self._optimizer.moments(name) if column.trained else [])
        ]
        column.assign(values)
        if column.trained:
            self._optimizer.replace_moments(name, moments)

    @torch.no_grad()
    def reset_rows(self, rows: Int[Tensor, " r"]) -> None:
        """Set the moments of these rows to zero, in every column."""
        for name, column in self._model.columns().items():
            if column.trained:
                for state in self._optimizer.moments(name):
                    for moment in (state.first, state.second):
                        column.write(rows, Rows.zeros_like(column.take(rows, moment)), moment)

    def reset_columns(self, names: Iterable[str]) -> None:
        """Set the moments of whole columns to zero; their step counts continue."""
        for name in names:
            for state in self._optimizer.moments(name):
                state.first.zero_()
                state.second.zero_()

    def _check(self, children: Children, expected_rows: int | None = None) -> None:
        """Check that new rows have every column, and the same number of rows in each."""
        columns = self._model.columns()
        expected, found = set(columns), set(children)
        if expected != found:
            raise ValueError(
                f"new rows: expected the columns {sorted(expected)}, found {sorted(found)}"
            )
        counts = {name: column.count(children[name]) for name, column in columns.items()}
        number = next(iter(counts.values())) if expected_rows is None else expected_rows
        if set(counts.values()) != {number}:
            raise ValueError(f"new rows: expected {number} in every column, found {counts}")
