"""Column code: the values of one column as numbers of steps, channel by channel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from gsfw.core.column import Layout
from gsfw.formats.compact.byte_blocks import ByteReader, packed
from gsfw.formats.compact.integer_code import decode_integers, encode_integers
from gsfw.formats.compact.steps import Form
from gsfw.formats.compact.value_forms import channels, quantised, restored

LARGEST = 2.0**40
"""Largest number of steps; columns with more are stored in half precision."""


@dataclass(frozen=True)
class FileColumn:
    """A column in the order of the file."""

    layout: Layout
    values: np.ndarray
    """[n, ...], [t, n, ...] or, of ragged ones, [m, ...]."""
    lengths: Int64[np.ndarray, " n"] | None = None
    """Number of values of each row; ``None`` unless ragged."""

    def take(self, rows: Int64[np.ndarray, " n"]) -> FileColumn:
        """The same rows in another order."""
        if self.layout is Layout.STACKED:
            return FileColumn(self.layout, self.values[:, rows])
        if self.lengths is None:
            return FileColumn(self.layout, self.values[rows])
        lengths = self.lengths[rows]
        starts = (np.cumsum(self.lengths) - self.lengths)[rows]
        return FileColumn(self.layout, self.values[_runs(starts, lengths)], lengths)


def _runs(starts: Int64[np.ndarray, " n"], lengths: Int64[np.ndarray, " n"]) -> np.ndarray:
    """start, start + 1, ... for each row, one row after the other."""
    before = np.cumsum(lengths) - lengths
    return np.repeat(starts - before, lengths) + np.arange(int(lengths.sum()))


def encode_steps(column: FileColumn, steps: Float64[np.ndarray, " n"], form: Form) -> bytes | None:
    """The bytes of a column; ``None`` if it has a value of too many steps.

    Args:
        column: with at least one value in each row's tensor.
        steps: of each row.
        form: what is divided into steps.
    """
    streams = []
    with np.errstate(over="ignore", divide="ignore"):
        if column.layout is Layout.STACKED:
            before: Int64[np.ndarray, "n e"] | int = 0
            for values in column.values:
                flat = values.reshape(len(values), -1).astype(np.float64)
                if not fits(flat, steps):
                    return None
                now = quantised(flat, steps, form)
                streams += [*(now - before).T]
                before = now
        else:
            for rows, places in _turns(column, len(steps)):
                flat = column.values[places].reshape(len(places), -1).astype(np.float64)
                if not fits(flat, steps[rows]):
                    return None
                streams += [*quantised(flat, steps[rows], form).T]
    return b"".join(encode_integers(stream) for stream in streams)


def fits(values: Float64[np.ndarray, "m d"], steps: Float64[np.ndarray, " m"]) -> bool:
    """True if no value has too many steps for this code."""
    return bool((np.abs(values) <= LARGEST * steps[:, None]).all())


def _turns(column: FileColumn, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rows that have a first value, a second one, and so on, and the places of these values."""
    if column.lengths is None:
        return [(np.arange(count), np.arange(count))]
    starts, turns = np.cumsum(column.lengths) - column.lengths, []
    for turn in range(int(column.lengths.max(initial=0))):
        rows = np.flatnonzero(column.lengths > turn)
        turns.append((rows, starts[rows] + turn))
    return turns


def decode_steps(
    content: bytes,
    empty: FileColumn,
    steps: Float64[np.ndarray, " n"],
    form: Form,
) -> None:
    """Read the values of a column into ``empty``, whose lengths are known.

    Raises:
        ValueError: the bytes are not those of such a column.
    """
    reader, values = ByteReader(content), empty.values
    stacked = empty.layout is Layout.STACKED
    per_row = math.prod(values.shape[2 if stacked else 1 :])
    width = channels(per_row, form)
    if form is Form.UNIT_QUATS and per_row != 4:
        raise ValueError(f"quaternions have {per_row} components")
    if form is Form.COLORS and per_row % 3:
        raise ValueError(f"colours have {per_row} numbers")
    if stacked:
        counts = np.zeros((len(steps), width), dtype=np.int64)
        for slot in values:
            counts += _decode_channels(reader, len(steps), width)
            slot[...] = restored(counts, steps, form).reshape(slot.shape)
    else:
        for rows, places in _turns(empty, len(steps)):
            counts = _decode_channels(reader, len(rows), width)
            found = restored(counts, steps[rows], form)
            values[places] = found.reshape(len(rows), *values.shape[1:])
    reader.finish()


def _decode_channels(reader: ByteReader, count: int, width: int) -> Int64[np.ndarray, "m e"]:
    counts = np.empty((count, width), dtype=np.int64)
    for channel in range(width):
        counts[:, channel] = decode_integers(reader, count)
    return counts


def encode_exactly(values: np.ndarray, stacked: bool = False) -> bytes:
    """Numbers of any type, byte by byte of each: bytes of one weight resemble one another.

    Args:
        values: in C order.
        stacked: store the difference of each from the one before along the first axis.
    """
    bits = _bits(np.ascontiguousarray(values))
    if stacked:
        bits = np.diff(bits, axis=0, prepend=np.zeros_like(bits[:1]))
    planes = bits.reshape(-1, 1).view(np.uint8)
    return b"".join(packed(plane.tobytes()) for plane in planes.T)


def decode_exactly(
    content: bytes, shape: tuple[int, ...], kind: np.dtype, stacked: bool = False
) -> np.ndarray:
    """Read numbers of a type.

    Raises:
        ValueError: the bytes are not those of so many numbers.
    """
    reader, count = ByteReader(content), math.prod(shape)
    planes = np.empty((count, kind.itemsize), dtype=np.uint8)
    for place in range(kind.itemsize):
        planes[:, place] = np.frombuffer(reader.unpacked(count), np.uint8)
    reader.finish()
    bits = _bits(planes.view(kind).reshape(shape))
    if stacked:
        np.cumsum(bits, axis=0, out=bits, dtype=bits.dtype)
    return bits.view(kind)


def _bits(values: np.ndarray) -> np.ndarray:
    """The same bytes as unsigned integers, of which sums wrap."""
    return values.view(f"<u{values.dtype.itemsize}")
