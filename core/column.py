"""Column: one per-splat quantity, with its learning rate beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from typing import Any

import torch
from jaxtyping import Int, Shaped
from torch import Tensor, nn

from gsfw.core.learning_rate import LearningRate
from gsfw.core.maths.ragged import row_offsets, value_indices


class Layout(Enum):
    """Layout of the rows in a column's tensor."""

    DENSE = "dense"
    """[n, ...]"""
    STACKED = "stacked"
    """[t, n, ...]: one value for each of t times."""
    RAGGED = "ragged"
    """[m, ...] with offsets [n + 1]: each row has its own number of values."""


@dataclass(frozen=True)
class Rows:
    """Some rows of a column, in the column's own layout."""

    values: Tensor
    """[r, ...] if dense, [t, r, ...] if stacked, the values of all rows one after another if
    ragged."""
    lengths: Int[Tensor, " r"] | None = None
    """Number of values of each row; ``None`` unless ragged."""

    @staticmethod
    def zeros_like(rows: Rows) -> Rows:
        """The same rows with every value zero (fresh optimizer moments)."""
        return Rows(torch.zeros_like(rows.values), rows.lengths)


class Column(nn.Module):
    """One per-splat quantity: dense, ragged or stacked over time; trained, or a buffer.

    The model owns its columns; only ``SplatTable`` changes their number of rows.
    """

    values: Tensor
    """The rows, in the layout of the column; a parameter if trained. Read anew in every step:
    an edit of rows replaces it."""
    offsets: Tensor | None
    """Start of each row among the values, [n + 1], if ragged; else ``None``."""

    def __init__(
        self,
        values: Shaped[Tensor, " ..."],
        learning_rate: LearningRate | None = None,
        layout: Layout = Layout.DENSE,
        offsets: Int[Tensor, " n_plus_1"] | None = None,
        bands: bool = False,
    ) -> None:
        """Store ``values`` without a change.

        Args:
            values: the rows, in the layout ``layout``.
            learning_rate: ``None`` makes this a buffer, which no optimizer touches.
            layout: the layout of the rows in ``values``.
            offsets: start of each row; given exactly when ragged.
            bands: true if the axis after the rows holds SH coefficients above the constant one,
                of which only those of the active degree are trained.
        """
        super().__init__()
        if (layout is Layout.RAGGED) != (offsets is not None):
            raise ValueError(
                f"a {layout.value} column: offsets are given exactly when it is ragged"
            )
        self.layout = layout
        self.learning_rate = learning_rate
        self.bands = bands
        self.register_buffer("offsets", offsets)
        self._set_values(values)

    def _set_values(self, values: Tensor) -> None:
        values = values.detach().contiguous()
        if self.learning_rate is None:
            self.register_buffer("values", values)
        else:
            self.values = nn.Parameter(values)

    @property
    def trained(self) -> bool:
        """True if an optimizer updates the column; false for a buffer."""
        return self.learning_rate is not None

    @property
    def num_rows(self) -> int:
        """Number of splats."""
        if self.offsets is not None:
            return len(self.offsets) - 1
        return self.values.shape[1 if self.layout is Layout.STACKED else 0]

    def slice(self, start: int, stop: int, values: Tensor | None = None) -> Rows:
        """Successive rows of the column, or of a tensor laid out like it, without a copy."""
        source = (self.values if values is None else values).detach()
        if self.layout is Layout.STACKED:
            return Rows(source[:, start:stop])
        if self.offsets is not None:
            first, last = int(self.offsets[start]), int(self.offsets[stop])
            return Rows(source[first:last], self.offsets[start : stop + 1].diff())
        return Rows(source[start:stop])

    @contextmanager
    def standing_for(self, rows: Rows) -> Iterator[None]:
        """Let the column have other rows for a time, such as a part of its own."""
        shown: dict[str, Tensor] = {"values": rows.values}
        if rows.lengths is not None:
            shown["offsets"] = row_offsets(rows.lengths)
        self.__dict__.update(shown)  # Found before the parameter, which stays as it is.
        try:
            yield
        finally:
            for name in shown:
                del self.__dict__[name]

    def _value_indices(self, rows: Int[Tensor, " r"]) -> tuple[Tensor, Tensor]:
        """Indices of the values of ragged ``rows``, and the number of values of each row."""
        assert self.offsets is not None
        lengths = self.offsets.diff()[rows]
        return value_indices(self.offsets[:-1][rows], lengths), lengths

    def count(self, rows: Rows) -> int:
        """Count the rows that ``rows`` holds.

        Raises:
            ValueError: the rows do not fit this column.
        """
        found = rows.values.shape
        axis = 1 if self.layout is Layout.STACKED else 0
        fits = (
            len(found) == self.values.dim()
            and found[:axis] == self.values.shape[:axis]
            and found[axis + 1 :] == self.values.shape[axis + 1 :]
            and (rows.lengths is not None) == (self.layout is Layout.RAGGED)
        )
        if fits and rows.lengths is not None:
            fits = int(rows.lengths.sum()) == found[0]
        if not fits:
            raise ValueError(
                f"rows of shape {tuple(found)} do not fit a {self.layout.value} column of shape "
                f"{tuple(self.values.shape)}"
            )
        return found[axis] if rows.lengths is None else len(rows.lengths)

    def resized(self, lengths: Int[Tensor, " n"], values: Tensor | None = None) -> Rows:
        """Resize every row of a ragged column: truncate its values, or append zeros.

        Args:
            lengths: new number of values of each row.
            values: a tensor laid out like the column (its moments); the column's own if ``None``.

        Raises:
            ValueError: the column is not ragged, or has another number of rows.
        """
        if self.offsets is None or len(lengths) != self.num_rows:
            raise ValueError(
                f"expected lengths for the {self.num_rows} rows of a ragged column, "
                f"found {len(lengths)} for a {self.layout.value} one"
            )
        source = (self.values if values is None else values).detach()
        common = torch.minimum(self.offsets.diff(), lengths)
        new = source.new_zeros(int(lengths.sum()), *source.shape[1:])
        kept = value_indices(row_offsets(lengths)[:-1], common)
        new[kept] = source[value_indices(self.offsets[:-1], common)]
        return Rows(new, lengths)

    def take(self, rows: Int[Tensor, " r"], values: Tensor | None = None) -> Rows:
        """Copy rows of the column, or of a tensor laid out like it (its moments)."""
        source = (self.values if values is None else values).detach()
        if self.layout is Layout.STACKED:
            return Rows(source[:, rows])
        if self.layout is Layout.RAGGED:
            indices, lengths = self._value_indices(rows)
            return Rows(source[indices], lengths)
        return Rows(source[rows])

    def join(self, first: Rows, second: Rows) -> Rows:
        """Concatenate the rows of ``first`` and of ``second``."""
        axis = 1 if self.layout is Layout.STACKED else 0
        values = torch.cat([first.values, second.values.to(first.values)], dim=axis)
        if first.lengths is None or second.lengths is None:
            return Rows(values)
        return Rows(values, torch.cat([first.lengths, second.lengths]))

    def assign(self, rows: Rows) -> None:
        """Replace all rows by ``rows``."""
        self._set_values(rows.values)
        if self.layout is Layout.RAGGED:
            assert rows.lengths is not None
            self.offsets = row_offsets(rows.lengths)

    def check_lengths(self, rows: Int[Tensor, " r"], new: Rows) -> None:
        """Check that overwriting ``rows`` keeps the number of values of every row.

        Raises:
            ValueError: a row would get another number of values.
        """
        if self.offsets is None:
            return
        if new.lengths is None or not torch.equal(self.offsets.diff()[rows], new.lengths):
            raise ValueError("ragged rows keep their number of values when overwritten")

    @torch.no_grad()
    def write(self, rows: Int[Tensor, " r"], new: Rows, values: Tensor | None = None) -> None:
        """Overwrite rows in place, in the column or in a tensor laid out like it.

        Raises:
            ValueError: a ragged row would change its number of values (use keep and append).
        """
        self.check_lengths(rows, new)
        target = self.values if values is None else values
        source = new.values.to(target)
        if self.layout is Layout.STACKED:
            target[:, rows] = source
        elif self.layout is Layout.RAGGED:
            target[self._value_indices(rows)[0]] = source
        else:
            target[rows] = source

    def _load_from_state_dict(
        self,
        state_dict: Mapping[str, Any],
        prefix: str,
        *args: Any,  # noqa: ANN401
    ) -> None:
        """Accept any number of rows: a checkpoint keeps its own row count."""
        values = state_dict.get(prefix + "values")
        if values is not None:
            self._set_values(values.to(self.values).clone())
        offsets = state_dict.get(prefix + "offsets")
        if offsets is not None and self.offsets is not None:
            self.offsets = offsets.to(self.offsets).clone()
        super()._load_from_state_dict(state_dict, prefix, *args)
