"""SpzHeader: what the header of an SPZ file states, and the sizes of the streams that follow.

Versions 1 to 3 are one gzip stream: 16 bytes of header, then the six streams. Version 4 has a plain
header of 32 bytes, a table of sizes, and each stream in Zstandard on its own.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.maths.spherical_harmonics import MAX_DEGREE, num_coefficients

MAGIC = b"NGSP"
COMMON = struct.Struct("<4sIIBBBB")
"""Magic, version, number of splats, SH degree, fractional bits, flags; streams of version 4."""
PLACES = struct.Struct("<I12x")
"""The rest of the header of version 4: the place of its table of sizes."""
ENTRY = struct.Struct("<QQ")
"""One stream in that table: compressed and raw size."""

HALVES, FIRST_THREE, PLAIN_HEADER = 1, 2, 4
"""The version whose positions are float16; the last one whose rotations are x, y and z; the one
with a plain header."""
ANTIALIASED, EXTENDED = 1, 2
"""Flags: trained with antialiasing; extension records follow."""
RECORD = struct.Struct("<II")
"""Head of an extension record: its kind, and bytes of what follows."""
COORDINATES = 0xADBE0003
"""Adobe's record of the axes of a file. Right, up and front are L or R (bit 0), D or U (bit 1), B
or F (bit 2) of its value, less one."""
AS_PLY = RECORD.pack(COORDINATES, 4) + (6).to_bytes(4, "little")
"""The record of axes as in PLY files: right, down, front."""
MOST_BITS = 23
"""Positions have 24 bits, one of them for the sign."""
MOST_DEGREE = {1: 3, 2: 3, 3: 3, 4: 4}
"""Highest SH degree that readers of each version expect."""


@dataclass(frozen=True)
class SpzHeader:
    """The header of a file."""

    version: int
    count: int
    degree: int
    bits: int
    """Bits of the positions after the point."""
    antialiased: bool
    is_extended: bool = False
    """True if records of extensions are in the file."""
    table: int = COMMON.size + PLACES.size
    """Place of the table of sizes in version 4."""

    @property
    def stream_sizes(self) -> tuple[int, ...]:
        """Bytes of positions, opacities, colours, scales, rotations and, if any, SH bands."""
        position = 6 if self.version == HALVES else 9
        rotation = 3 if self.version <= FIRST_THREE else 4
        bands = 3 * (num_coefficients(self.degree) - 1)
        widths = (position, 1, 3, 3, rotation, *((bands,) if bands else ()))
        return tuple(self.count * width for width in widths)

    def to_bytes(self) -> bytes:
        """The header as a file begins."""
        plain = self.version >= PLAIN_HEADER
        streams = len(self.stream_sizes) if plain else 0
        flags = ANTIALIASED * self.antialiased + EXTENDED * self.is_extended
        common = COMMON.pack(
            *(MAGIC, self.version, self.count, self.degree, self.bits, flags, streams)
        )
        return common + PLACES.pack(self.table) if plain else common


def read_header(path: Path, start: bytes) -> SpzHeader:
    """The header in the first decompressed bytes of a file.

    Args:
        path: the file, for messages.
        start: 16 bytes, or 32 of version 4; fewer if the file has no more.

    Raises:
        DataError: it states what no file of this format has.
    """
    if not start.startswith(MAGIC):
        raise DataError(f"{path} is not an SPZ file: it does not begin with 'NGSP'.")
    if len(start) < COMMON.size:
        raise DataError(
            f"{path} is cut short: its header ends after {len(start)} bytes.", COPY_AGAIN
        )
    _, version, count, degree, bits, flags, streams = COMMON.unpack_from(start)
    if version not in MOST_DEGREE:
        raise DataError(
            f"{path} is SPZ of version {version}; versions 1 to {max(MOST_DEGREE)} are read.",
            "Convert it to version 3 with the tool that made it.",
        )
    if count == 0:
        raise DataError(f"{path} contains no splats: its header announces 0.")
    if degree > MAX_DEGREE or (bits > MOST_BITS and version != HALVES):
        what = f"SH degree {degree}" if degree > MAX_DEGREE else f"{bits} fractional bits"
        raise DataError(f"{path} is a damaged SPZ file: its header states {what}.", COPY_AGAIN)
    header = SpzHeader(
        version, count, degree, bits, bool(flags & ANTIALIASED), bool(flags & EXTENDED)
    )
    return header if version < PLAIN_HEADER else _with_places(path, start, header, streams)


def _with_places(path: Path, start: bytes, header: SpzHeader, streams: int) -> SpzHeader:
    """The header of version 4, with the place of its table."""
    size = COMMON.size + PLACES.size
    if len(start) < size:
        raise DataError(
            f"{path} is cut short: its header ends after {len(start)} bytes.", COPY_AGAIN
        )
    (table,) = PLACES.unpack_from(start, COMMON.size)
    expected = len(header.stream_sizes)
    if streams != expected or table < size:
        found = f"{streams} streams, expected {expected}" if streams != expected else f"{table}"
        what = found if streams != expected else f"its table of sizes at byte {found}"
        raise DataError(f"{path} is a damaged SPZ file: its header states {what}.", COPY_AGAIN)
    return SpzHeader(
        *(header.version, header.count, header.degree, header.bits),
        *(header.antialiased, header.is_extended, table),
    )
