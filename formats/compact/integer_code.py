"""Integer code: sequences of small integers as digits that fill bytes, then LZMA.

Several digits to a base share a byte, as many as fit: an entropy coder of bytes spends a fiftieth
of a bit at least on every bit, which is more than a value that is nearly always zero has. Values
that the digits do not reach are coded apart, in planes of bytes. The base is the one with the
fewest bytes for a sample.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from gsfw.formats.compact.byte_blocks import ByteReader, packed

BASES = (256, 16, 6, 3)
"""Bases of digits; a byte takes 1, 2, 3 and 5 of them."""
DIGITS = {256: 1, 16: 2, 6: 3, 3: 5}
SAMPLE = 1 << 14
"""Values with which bases are compared."""
MAX_PLANES = 8


def encode_integers(values: Int[np.ndarray, " n"]) -> bytes:
    """The bytes of signed integers."""
    folded = _folded(values.astype(np.int64))
    base = min(BASES, key=lambda base: len(_with_base(folded[:SAMPLE], base)))
    return bytes([BASES.index(base)]) + _with_base(folded, base)


def decode_integers(reader: ByteReader, count: int) -> Int[np.ndarray, " n"]:
    """Read ``count`` integers.

    Raises:
        ValueError: the bytes are not those of so many integers.
    """
    (index,) = reader.take(1)
    if index >= len(BASES):
        raise ValueError(f"integers have the base {index}, expected at most {len(BASES) - 1}")
    base = BASES[index]
    fit = DIGITS[base]
    held = np.frombuffer(reader.unpacked(-(-count // fit)), np.uint8)
    digits = (held[:, None].astype(np.int64) // _powers(base)) % base
    values = digits.reshape(-1)[:count]
    larger = np.flatnonzero(values == base - 1)
    if len(larger):
        values[larger] += _decode_planes(reader, len(larger))
    return (values >> 1) ^ -(values & 1)


def _folded(values: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """0, -1, 1, -2, ... as 0, 1, 2, 3, ..."""
    return (values << 1) ^ (values >> 63)


def _powers(base: int) -> Int[np.ndarray, " p"]:
    return base ** np.arange(DIGITS[base])


def _with_base(folded: Int[np.ndarray, " n"], base: int) -> bytes:
    digits = np.minimum(folded, base - 1)
    filling = np.zeros(-len(digits) % DIGITS[base], dtype=np.int64)
    held = np.concatenate([digits, filling]).reshape(-1, DIGITS[base]) @ _powers(base)
    beyond = folded[folded >= base - 1] - (base - 1)
    return packed(held.astype(np.uint8).tobytes()) + (_planes(beyond) if len(beyond) else b"")


def _planes(values: Int[np.ndarray, " n"]) -> bytes:
    """Integers of at least 0, byte by byte."""
    count = max(1, -(-int(values.max()).bit_length() // 8))
    planes = values.astype("<u8").view(np.uint8).reshape(-1, 8)[:, :count]
    return bytes([count]) + b"".join(packed(plane.tobytes()) for plane in planes.T)


def _decode_planes(reader: ByteReader, count: int) -> Int[np.ndarray, " n"]:
    (planes,) = reader.take(1)
    if not 1 <= planes <= MAX_PLANES:
        raise ValueError(f"integers of {planes} bytes, expected 1 to {MAX_PLANES}")
    held = np.zeros((count, 8), dtype=np.uint8)
    for plane in range(planes):
        held[:, plane] = np.frombuffer(reader.unpacked(count), np.uint8)
    return held.view("<u8")[:, 0].astype(np.int64)
