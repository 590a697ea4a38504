"""State writer: the state of a model in steps and entropy coded.

Columns that ``steps`` has a rule for are divided into steps; all else is stored as exactly as half
precision allows (``half_precision``), byte by byte. The rows are sorted; a model renders the same
in any order of its rows, so the order is stored only where state beside the columns may follow it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from torch import Tensor

from gsfw.core.column import Layout
from gsfw.core.exchange import StoredColumn, StoredModel
from gsfw.formats.array_archive import DTYPES
from gsfw.formats.compact.column_code import FileColumn, encode_exactly, encode_steps
from gsfw.formats.compact.half_precision import halved
from gsfw.formats.compact.integer_code import encode_integers
from gsfw.formats.compact.row_order import RowOrder, has_rows_elsewhere
from gsfw.formats.compact.steps import EVIDENCE, rule_of

STEPPED = ("<f4", "<i2")
"""Types of columns that are divided into steps."""
EXPANSION, SMALL, PER_ROW = 256, 1 << 20, 64
"""A reader reserves at most ``EXPANSION`` bytes for each byte of a file, and ``SMALL`` ones in any
case; ``PER_ROW`` ones are those of a row while it is read. A writer fills up the rare file whose
state needs more."""


def least_bytes(state: int, rows: int) -> int:
    """Bytes that a file of a state of so many bytes has at least."""
    return max(0, -(-(state + PER_ROW * rows - SMALL) // EXPANSION))


@dataclass(frozen=True)
class Encoded:
    """A state in the form of a file."""

    document: Mapping[str, Any]
    """The description of it in the header."""
    rows: bytes
    """Positions, fineness and, if it is kept, order of the rows; empty if they are not sorted."""
    tensors: Mapping[str, bytes]
    """Bytes of the tensors by name."""

    @property
    def num_bytes(self) -> int:
        """Bytes of everything but the document."""
        return len(self.rows) + sum(map(len, self.tensors.values()))


def encode_model(
    model: StoredModel, step: float, contributions: Float[Tensor, " n"] | None = None
) -> Encoded:
    """The state of a model.

    Args:
        model: the model.
        step: factor of all steps.
        contributions: of its rows to the training views; ``None`` for an estimate.

    Raises:
        ValueError: the format has no such type of numbers; names the tensor.
    """
    order = RowOrder.of(model, step, contributions) if RowOrder.fits(model) else None
    keep = order is not None and has_rows_elsewhere(model)
    writer = _Writer(model, order, step, halved(model))
    found = {name: writer.tensor(name) for name in model.state}
    document = {
        "sorted": order is not None,
        "keeps_order": keep,
        "arrays": {name: entry for name, (entry, _) in found.items()},
    }
    tensors = {name: content for name, (_, content) in found.items()}
    return Encoded(document, b"" if order is None else order.encode(keep=keep), tensors)


def num_filling(model: StoredModel, encoded: Encoded) -> int:
    """Bytes that a file lacks to hold as much state as this."""
    state = sum(tensor.nbytes for tensor in model.state.values())
    return max(0, least_bytes(state, model.rows) - encoded.num_bytes)


@dataclass(frozen=True)
class _Writer:
    """Writes the tensors of a model one by one."""

    model: StoredModel
    order: RowOrder | None
    step: float
    halves: Mapping[str, Tensor]

    def tensor(self, name: str) -> tuple[dict[str, Any], bytes]:
        """The description of a tensor in the header, and its bytes."""
        tensor = self.model.state[name]
        kind = _array(tensor).dtype
        if kind.str not in DTYPES:
            raise ValueError(f"{name} is of type {kind}")
        about = {"type": kind.str, "shape": list(tensor.shape)}
        for label, column in self.model.columns.items():
            if name == column.offsets:
                lengths = self._column(column).lengths
                assert lengths is not None
                return {"form": "offsets", **about}, encode_integers(lengths)
            if name == column.values:
                return self._values(name, label, column, about)
        stored = _array(self.halves.get(name, tensor))
        return {"form": "exact", **about, "stored": stored.dtype.str}, encode_exactly(stored)

    def _values(
        self, name: str, label: str, column: StoredColumn, about: dict[str, Any]
    ) -> tuple[dict[str, Any], bytes]:
        """The same for the values of a column."""
        if label in EVIDENCE:
            return {"form": "none", **about}, b""
        rule, order = rule_of(label, self.model), self.order
        if order is not None and label == "means":
            return {"form": "positions", **about}, b""
        if order is not None and rule is not None and about["type"] in STEPPED:
            step = rule.step * self.step
            held = self._column(column)
            content = encode_steps(held, order.steps(step, rule.unit), rule.form)
            if content is not None:
                entry = {"form": rule.form.value, "step": step, "unit": rule.unit.value}
                return {**entry, **about}, content
        stored = self._column(column, self.halves.get(name)).values
        exact = encode_exactly(stored, column.layout is Layout.STACKED)
        return {"form": "exact", **about, "stored": stored.dtype.str}, exact

    def _column(self, column: StoredColumn, values: Tensor | None = None) -> FileColumn:
        """A column in the order of the file."""
        state = self.model.state
        array = _array(state[column.values] if values is None else values)
        lengths = None if column.offsets is None else state[column.offsets].diff().numpy()
        held = FileColumn(column.layout, array, lengths)
        return held if self.order is None else held.take(self.order.rows)


def _array(tensor: Tensor) -> np.ndarray:
    return tensor.detach().cpu().contiguous().numpy()
