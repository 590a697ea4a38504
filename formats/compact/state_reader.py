"""State reader: the state of a model from untrusted bytes (see ``state_writer``)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from gsfw.core.column import Layout
from gsfw.core.errors import DataError
from gsfw.core.exchange import StoredColumn, StoredModel
from gsfw.core.files.json_fields import BROKEN, JsonFields
from gsfw.formats.array_archive import DTYPES
from gsfw.formats.compact.byte_blocks import ByteReader
from gsfw.formats.compact.column_code import FileColumn, decode_exactly, decode_steps
from gsfw.formats.compact.integer_code import decode_integers
from gsfw.formats.compact.row_order import RowOrder
from gsfw.formats.compact.state_writer import STEPPED, least_bytes
from gsfw.formats.compact.steps import Form, Unit

MOST_AXES = 8


@dataclass(frozen=True)
class Entry:
    """The description of one tensor in the header."""

    fields: JsonFields
    form: str
    kind: np.dtype
    shape: tuple[int, ...]

    @staticmethod
    def of(fields: JsonFields) -> Entry:
        """Check an entry of the header.

        Raises:
            DataError: it has no type or no shape.
        """
        kind, shape = fields.text("type"), fields.numbers("shape", -1)
        sizes = (shape >= 0) & (shape == np.rint(shape))
        if kind not in DTYPES or len(shape) > MOST_AXES or not sizes.all():
            raise DataError(f"{fields.path}: {fields.where} of its header has no shape.", BROKEN)
        return Entry(fields, fields.text("form"), np.dtype(kind), tuple(map(int, shape)))

    @property
    def num_bytes(self) -> int:
        """Bytes of the tensor."""
        return math.prod(self.shape) * self.kind.itemsize

    def stored(self) -> np.dtype:
        """The type in which exact values are stored.

        Raises:
            ValueError: it is unknown.
        """
        kind = self.fields.text("stored")
        if kind not in DTYPES:
            raise ValueError(f"values are stored as {kind}")
        return np.dtype(kind)


@dataclass(frozen=True)
class StateReader:
    """Reads the state of a model."""

    model: StoredModel
    """Columns of the model, and their number of rows."""
    fields: JsonFields
    """The description of the state in the header."""
    rows: bytes
    tensors: Mapping[str, np.ndarray]
    """Bytes of the tensors by name."""

    def state(self, num_bytes: int) -> dict[str, Tensor]:
        """All tensors, of a file of so many bytes.

        Raises:
            DataError: the header and the bytes contradict each other; names the tensor.
        """
        held = sum(entry.num_bytes for entry in self._entries.values())
        if least_bytes(held, self.model.rows) > num_bytes:
            raise self._refusal("it announces more state than a file of its size can hold")
        state: dict[str, Tensor] = {}
        place = "rows"
        try:
            # Values that are out of range become infinite, and are refused later.
            with np.errstate(over="ignore", invalid="ignore"):
                for place in self._entries:
                    state |= self._tensors(place)
        except DataError:
            raise
        except (ValueError, IndexError) as error:
            raise self._refusal(f"{place}: {error}") from error
        return state

    def _refusal(self, problem: str) -> DataError:
        return DataError(f"{self.fields.path} is damaged: {problem}.", BROKEN)

    @cached_property
    def _entries(self) -> dict[str, Entry]:
        named = self.fields.fields("arrays")
        return {name: Entry.of(named.fields(name)) for name in named.values}

    @cached_property
    def _rows(self) -> RowOrder | None:
        keep = self.fields.flag("keeps_order")
        if not self.fields.flag("sorted"):
            return None
        return RowOrder.decode(self.rows, self.model.rows, keep=keep)

    @cached_property
    def _original(self) -> np.ndarray | None:
        """Row of the file of each row of the model; ``None`` if the order is that of the file."""
        rows = self._rows
        return np.argsort(rows.rows) if rows and self.fields.flag("keeps_order") else None

    def _bytes(self, name: str) -> bytes:
        if name in self.tensors:
            return self.tensors[name].tobytes()
        if self._entries[name].num_bytes:
            raise ValueError("it has no bytes")
        return b""  # A ragged column whose rows are all empty.

    def _tensors(self, name: str) -> dict[str, Tensor]:
        """A tensor; that of a ragged column with its offsets, which then have none of their own."""
        for label, column in self.model.columns.items():
            if name == column.values:
                return self._column(label, column)
            if name == column.offsets:
                return {}
        entry = self._entries[name]
        return {name: torch.from_numpy(self._exact(name, entry, stacked=False))}

    def _column(self, label: str, column: StoredColumn) -> dict[str, Tensor]:
        entry, lengths = self._entries[column.values], None
        if column.offsets is not None:
            lengths = self._lengths(column.offsets, entry)
        held = FileColumn(column.layout, self._values(label, column, lengths), lengths)
        if self._original is not None:
            held = held.take(self._original)
        found = {column.values: torch.from_numpy(np.ascontiguousarray(held.values))}
        if column.offsets is not None and held.lengths is not None:
            starts = np.concatenate([[0], np.cumsum(held.lengths)])
            found[column.offsets] = torch.from_numpy(starts)
        return found

    def _lengths(self, name: str, values: Entry) -> np.ndarray:
        if name not in self._entries:
            raise ValueError(f"the header has no {name}")
        reader = ByteReader(self._bytes(name))
        lengths = decode_integers(reader, self.model.rows)
        reader.finish()
        most = values.shape[0] if values.shape else 0
        if (lengths < 0).any() or (lengths > most).any() or int(lengths.sum()) != most:
            raise ValueError(f"its rows do not have {most} values")
        return lengths

    def _values(self, label: str, column: StoredColumn, lengths: np.ndarray | None) -> np.ndarray:
        """Values of a column in the order of the file."""
        entry, rows = self._entries[column.values], self._rows
        stacked = column.layout is Layout.STACKED
        if lengths is None and self.model.rows not in entry.shape[stacked : stacked + 1]:
            raise ValueError(f"it has the shape {entry.shape} for {self.model.rows} rows")
        if entry.form == "none":
            return np.zeros(entry.shape, dtype=entry.kind)
        if entry.form == "exact":
            return self._exact(column.values, entry, stacked=stacked)
        if rows is None or entry.kind.str not in STEPPED:
            raise ValueError(f"its form is {entry.form!r}, with which its type does not go")
        if entry.form == "positions":
            if entry.shape != (self.model.rows, 3):
                raise ValueError(f"positions have the shape {entry.shape}")
            return rows.lattice.centers().astype(entry.kind)
        form, unit = Form(entry.form), Unit(entry.fields.text("unit"))
        steps = rows.steps(entry.fields.positive("step"), unit)
        empty = FileColumn(column.layout, np.zeros(entry.shape, dtype=np.float32), lengths)
        decode_steps(self._bytes(column.values), empty, steps, form)
        return _as(entry.kind, empty.values)

    def _exact(self, name: str, entry: Entry, *, stacked: bool) -> np.ndarray:
        stored = entry.stored()
        found = decode_exactly(self._bytes(name), entry.shape, stored, stacked)
        return _as(entry.kind, found)


def _as(kind: np.dtype, values: np.ndarray) -> np.ndarray:
    """The values in another type, whole numbers within its range."""
    if kind.kind == "i" and values.dtype.kind == "f":
        bounds = np.iinfo(kind)
        values = np.rint(np.nan_to_num(values)).clip(bounds.min, bounds.max)
    return values.astype(kind, copy=False)
