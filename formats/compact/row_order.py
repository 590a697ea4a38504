"""RowOrder: the order of a compressed model's rows, with their positions and steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float64, Int64
from torch import Tensor

from gsfw.core.exchange import StoredModel
from gsfw.formats.compact.byte_blocks import ByteReader
from gsfw.formats.compact.integer_code import decode_integers, encode_integers
from gsfw.formats.compact.position_code import Lattice
from gsfw.formats.compact.steps import MOST, PITCH, Unit, dense_column, fineness

MEANS = "means"


@dataclass(frozen=True)
class RowOrder:
    """The rows of a model as its file has them: from the finest steps to the coarsest.

    Rows with the same steps are beside one another, so that an adaptive coder sees numbers of one
    distribution; among them, neighbours in space are near.
    """

    lattice: Lattice
    fineness: Int64[np.ndarray, " n"]
    """Exponent of each row's steps, in units of the square root of 2; ascending."""
    rows: Int64[np.ndarray, " n"]
    """Row of the model of each row of the file."""

    @staticmethod
    def of(model: StoredModel, step: float, contributions: Float[Tensor, " n"] | None) -> RowOrder:
        """The order of a model whose means and scales are dense; see ``fits``.

        Args:
            model: to be stored.
            step: factor of all steps.
            contributions: of its rows to the training views; ``None`` for an estimate.
        """
        means = dense_column(model, MEANS)
        assert means is not None
        lattice = Lattice.of(means.double().numpy(), _pitches(model, step))
        exponents = fineness(model, contributions)
        rows = lattice.order()
        rows = rows[np.argsort(exponents[rows], kind="stable")]
        return RowOrder(lattice.take(rows), exponents[rows], rows)

    @staticmethod
    def fits(model: StoredModel) -> bool:
        """True if a model has the columns that the order depends on."""
        means, log_scales = dense_column(model, MEANS), dense_column(model, "log_scales")
        same = (model.rows, 3)
        return (
            means is not None
            and log_scales is not None
            and tuple(means.shape) == tuple(log_scales.shape) == same
        )

    def steps(self, step: float, unit: Unit) -> Float64[np.ndarray, " n"]:
        """Step of each row."""
        if unit is Unit.PITCH:
            return step * self.lattice.pitches()
        if unit is Unit.ROW:
            return step * np.exp2(self.fineness / 2)
        return np.full(len(self.rows), step)

    def encode(self, *, keep: bool) -> bytes:
        """The bytes; with ``keep`` the model's own order can be restored."""
        order = self.lattice.order()
        place = encode_integers(self.rows) if keep else b""
        return self.lattice.take(order).encode() + encode_integers(self.fineness[order]) + place

    @staticmethod
    def decode(content: bytes, count: int, *, keep: bool) -> RowOrder:
        """Read ``count`` rows.

        Raises:
            ValueError: the bytes are not those of so many rows.
        """
        reader = ByteReader(content)
        lattice, exponents = Lattice.decode(reader, count), decode_integers(reader, count)
        if (np.abs(exponents) > MOST).any():
            raise ValueError("the steps of a row are out of range")
        order = np.argsort(exponents, kind="stable")
        rows = decode_integers(reader, count) if keep else np.arange(count, dtype=np.int64)
        if keep and not np.array_equal(np.sort(rows), np.arange(count)):
            raise ValueError("the order of the rows is no permutation")
        reader.finish()
        return RowOrder(lattice.take(order), exponents[order], rows)


def _pitches(model: StoredModel, step: float) -> Float64[np.ndarray, " n"]:
    """The pitches that a model brings, or those that its sizes ask for."""
    if model.pitches is not None:
        return model.pitches.double().cpu().numpy()
    log_scales = dense_column(model, "log_scales")
    assert log_scales is not None
    shortest = np.exp(log_scales.double().amin(dim=1).cpu().numpy())
    return np.maximum(PITCH * step * shortest, np.finfo(np.float32).tiny)


def has_rows_elsewhere(model: StoredModel) -> bool:
    """True if state beside the columns may be one per row, so that the rows keep their order."""
    held = {part for column in model.columns.values() for part in (column.values, column.offsets)}
    return any(
        model.rows in tensor.shape
        for name, tensor in model.state.items()
        if name not in held and isinstance(tensor, torch.Tensor)
    )
