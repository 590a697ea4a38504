"""The headers of KSPLAT and the records of its splats, as SplatBuffer.js of 0.4.7 has them."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from gsfw.core.maths.spherical_harmonics import num_coefficients

VERSION = (0, 1)
MAIN_BYTES, SECTION_BYTES = 4096, 1024
MAIN = struct.Struct("<BB2xIIIIH2x3fff")
"""Version; announced sections, sections, announced splats, splats; level; centre; SH range."""
SECTION = struct.Struct("<IIIIfH2xIIIIH")
"""Splats, announced splats, splats of a full bucket, buckets, size of a bucket's block, bytes of a
centre, largest position step, bytes, full and partial buckets, SH degree."""
CENTER_BYTES = 12
"""A centre: three float32."""
RANGE = 32767
"""Steps from the centre of a bucket to each side of its block."""
SH_RANGE = 1.5
"""Magnitude of SH coefficients in bytes, where the header has 0."""
LEVELS = (0, 1, 2)
KINDS = {0: ("<f4", "<f4", "<f4"), 1: ("<u2", "<f2", "<f2"), 2: ("<u2", "<f2", "u1")}
"""Types of positions, of scales and rotations, and of SH coefficients, by level."""


def record_type(level: int, degree: int) -> np.dtype[np.void]:
    """One splat. SH coefficients are band by band, and in each band channel by channel."""
    position, shape, bands = KINDS[level]
    fields = [
        ("position", position, (3,)),
        ("scale", shape, (3,)),
        ("quat", shape, (4,)),
        ("rgba", "u1", (4,)),
    ]
    if degree:
        fields.append(("sh", bands, (3 * (num_coefficients(degree) - 1),)))
    return np.dtype(fields)


@dataclass(frozen=True)
class Section:
    """The header of one section."""

    count: int
    room: int
    """Splats that the section has room for."""
    bucket_size: int
    buckets: int
    block: float
    """Side of the cube that the splats of one bucket lie in."""
    center_bytes: int
    steps: int
    full: int
    partial: int
    degree: int

    @staticmethod
    def read(raw: bytes) -> Section:
        """The section of a header."""
        count, room, size, buckets, block, width, steps, _, full, partial, degree = (
            SECTION.unpack_from(raw)
        )
        return Section(
            count, room, size, buckets, block, width, steps or RANGE, full, partial, degree
        )

    @property
    def bucket_bytes(self) -> int:
        """Bytes before the splats: lengths of partial buckets, and centres."""
        return 4 * self.partial + self.center_bytes * self.buckets

    def to_bytes(self, level: int) -> bytes:
        """The header, with the size that follows from the others."""
        stored = self.bucket_bytes + self.room * record_type(level, self.degree).itemsize
        header = SECTION.pack(
            *(self.count, self.room, self.bucket_size, self.buckets, self.block),
            *(self.center_bytes, self.steps, stored & 0xFFFFFFFF, self.full, self.partial),
            self.degree,
        )
        return header.ljust(SECTION_BYTES, b"\0")
