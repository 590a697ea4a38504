"""Position code: positions as sorted numbers of the cells of lattices.

The rows are sorted by the pitch of their lattice, then along the Morton curve, and only the gaps
between neighbours are stored: a set of n points needs log2(n!) bits less than a sequence. A gap g
is the number of bits of g + 1, through the entropy coder, and the bits below the first as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float64, Int, Int64

from gsfw.formats.compact.byte_blocks import ByteReader
from gsfw.formats.compact.integer_code import decode_integers, encode_integers
from gsfw.formats.morton_order import BITS, morton_cells, morton_codes

HALF = 1 << (BITS - 1)
"""Cells from the origin to the border of a lattice."""
EXPONENTS = (-140, 120)
"""Range of the exponents of pitches: those of positive float32 numbers, and a margin."""


@dataclass(frozen=True)
class Lattice:
    """Cells of rows on cubic lattices around the origin, each with a pitch of 2 ** exponent."""

    cells: Int64[np.ndarray, "n 3"]
    exponents: Int64[np.ndarray, " n"]

    @staticmethod
    def of(means: Float64[np.ndarray, "n 3"], pitches: Float64[np.ndarray, " n"]) -> Lattice:
        """The nearest cells, with the powers of two that are nearest to ``pitches``.

        Far from the origin a pitch is coarser, so that the cells can be numbered.
        """
        reach = np.abs(means).max(axis=1, initial=0.0) / (HALF - 1)
        least = np.ceil(np.log2(np.maximum(reach, 2.0 ** EXPONENTS[0])))
        exponents = np.clip(np.maximum(np.rint(np.log2(pitches)), least), *EXPONENTS)
        cells = np.rint(means / np.exp2(exponents)[:, None])
        return Lattice(cells.astype(np.int64), exponents.astype(np.int64))

    def order(self) -> Int64[np.ndarray, " n"]:
        """The rows by pitch, then along the Morton curve; ties in the order of rows."""
        return np.lexsort((self._codes(), self.exponents))

    def take(self, rows: Int[np.ndarray, " r"]) -> Lattice:
        """Some of the rows."""
        return Lattice(self.cells[rows], self.exponents[rows])

    def pitches(self) -> Float64[np.ndarray, " n"]:
        """Size of the cells of each row."""
        return np.exp2(self.exponents.astype(np.float64))

    def centers(self) -> Float64[np.ndarray, "n 3"]:
        """Position of each row; at most half a pitch from the original along each axis."""
        return self.cells * self.pitches()[:, None]

    def _codes(self) -> Int64[np.ndarray, " n"]:
        return morton_codes((self.cells + HALF).astype(np.uint64)).astype(np.int64)

    def encode(self) -> bytes:
        """The bytes of rows in ``order``."""
        starts = np.diff(self.exponents, prepend=EXPONENTS[0] - 1)
        gaps = np.diff(self._codes(), prepend=0)
        first = np.flatnonzero(starts)
        gaps[first] = self._codes()[first]
        lengths = _bit_lengths(gaps + 1) - 1
        bits = _bit_planes(gaps + 1, lengths)
        return encode_integers(starts) + encode_integers(lengths) + bits

    @staticmethod
    def decode(reader: ByteReader, count: int) -> Lattice:
        """Read ``count`` rows, in their order.

        Raises:
            ValueError: the bytes are not those of so many rows.
        """
        starts = decode_integers(reader, count)
        if (starts < 0).any() or (starts > EXPONENTS[1] - EXPONENTS[0] + 1).any():
            raise ValueError("the pitches of positions do not ascend")
        exponents = EXPONENTS[0] - 1 + np.cumsum(starts)
        if count and not EXPONENTS[0] <= exponents[0] <= exponents[-1] <= EXPONENTS[1]:
            raise ValueError("the pitches of positions are out of range")
        lengths = decode_integers(reader, count)
        if (lengths < 0).any() or (lengths > 3 * BITS).any():
            raise ValueError("the gaps between positions are out of range")
        gaps = _from_bit_planes(reader, lengths) - 1
        codes = _sums(gaps, starts > 0)
        if (codes < 0).any() or (codes >> (3 * BITS)).any():
            raise ValueError("positions lie outside of their lattice")
        return Lattice(morton_cells(codes.astype(np.uint64)).astype(np.int64) - HALF, exponents)


def _sums(gaps: Int64[np.ndarray, " n"], starts: np.ndarray) -> Int64[np.ndarray, " n"]:
    """Sums of gaps, anew from every start; numbers that overflow become negative somewhere."""
    codes = np.empty_like(gaps)
    edges = [*np.flatnonzero(starts).tolist(), len(gaps)]
    for first, last in pairwise(edges):
        np.cumsum(gaps[first:last], out=codes[first:last])
    return codes


def _bit_lengths(values: Int64[np.ndarray, " n"]) -> Int64[np.ndarray, " n"]:
    """Number of bits of positive integers."""
    lengths = np.zeros_like(values)
    for shift in (32, 16, 8, 4, 2, 1):
        larger = values >= (np.int64(1) << shift)
        lengths += shift * larger
        values = np.where(larger, values >> shift, values)
    return lengths + 1


def _bit_planes(values: Int64[np.ndarray, " n"], lengths: Int64[np.ndarray, " n"]) -> bytes:
    """The bits below the first of each value, place by place, eight to a byte."""
    planes = []
    for place in range(int(lengths.max(initial=0))):
        bits = (values[lengths > place] >> place) & 1
        planes.append(np.packbits(bits.astype(np.uint8)).tobytes())
    return b"".join(planes)


def _from_bit_planes(
    reader: ByteReader, lengths: Int64[np.ndarray, " n"]
) -> Int64[np.ndarray, " n"]:
    values = np.int64(1) << lengths
    for place in range(int(lengths.max(initial=0))):
        rows = np.flatnonzero(lengths > place)
        held = np.frombuffer(reader.take(-(-len(rows) // 8)), np.uint8)
        values[rows] |= np.unpackbits(held, count=len(rows)).astype(np.int64) << place
    return values
