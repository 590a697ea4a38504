"""Reading of SPZ containers: the header, the raw streams, and the frame that extensions state.

Nothing is decompressed beyond what the header announces, and the header is believed only as far as
the size of the file justifies.
"""

from __future__ import annotations

import zlib
from itertools import accumulate
from pathlib import Path
from typing import BinaryIO

import numpy as np

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.files.reading import first_bytes, readable
from gsfw.formats.spz.layout import (
    COMMON,
    COORDINATES,
    ENTRY,
    MAGIC,
    PLACES,
    PLAIN_HEADER,
    RECORD,
    SpzHeader,
    read_header,
)
from gsfw.formats.spz.quantisation import Bytes
from gsfw.formats.spz.zstandard import DamagedStreamError, check_available, decompressed
from gsfw.formats.stored_rows import RDF_TO_RUB, Signs

GZIP = b"\x1f\x8b"
PART = 1 << 20
"""Bytes that are read and decompressed at once."""
ALWAYS, RATIO = 1 << 26, 200
"""Streams of 64 MB (a million splats of SH degree 3) may be compressed as far as they can be;
larger ones to a 200th. Real scenes are compressed to a half or a third."""
MOST_EXTENSIONS = 1 << 16
"""Bytes of extension records, a few dozen each."""
UNSPECIFIED, LAST_MIRRORED = 0, 8
"""Values of the record of axes: no statement; the last frame whose axes are ours but for signs."""


def read_streams(path: Path) -> tuple[SpzHeader, list[Bytes], Signs]:
    """The header, the raw streams, and the signs of the axes of our frame in that of the file.

    Raises:
        DataError: the file is damaged or no SPZ.
        UnavailableError: it is version 4, and Zstandard is not installed.
    """
    with readable(path), path.open("rb") as file:
        size = path.stat().st_size
        start = file.read(COMMON.size + PLACES.size)
        if start.startswith(GZIP):
            file.seek(0)
            return _compressed_whole(path, file, size)
        header = read_header(path, start)
        if header.version >= PLAIN_HEADER:
            return _compressed_by_stream(path, file, header, size)
        file.seek(COMMON.size)
        _check_announced(path, header, size, size - COMMON.size)
        return _split(path, header, file.read())


PEEK = 1024
"""Bytes from which the mark is unpacked: the tables of a first block of gzip take up to 400."""


def begins_like_spz(path: Path) -> bool:
    """True if the first bytes, decompressed if need be, are those of an SPZ file."""
    start = first_bytes(path, PEEK)
    if start.startswith(GZIP):
        try:
            start = zlib.decompressobj(wbits=31).decompress(start, len(MAGIC))
        except zlib.error:
            return False
    return start.startswith(MAGIC)


def _check_announced(path: Path, header: SpzHeader, size: int, most: int) -> None:
    """Refuse an announced number of splats that the size of the file does not justify."""
    announced = sum(header.stream_sizes)
    if announced > most:
        raise DataError(
            f"{path} is cut short or damaged: its header announces {header.count} splats, "
            f"{announced} bytes, which a file of {size} bytes cannot hold.",
            COPY_AGAIN,
        )


def _compressed_whole(
    path: Path, file: BinaryIO, size: int
) -> tuple[SpzHeader, list[Bytes], Signs]:
    """Versions 1 to 3."""
    inflater = _Inflater(path, file)
    start = bytes(inflater.read(COMMON.size))
    if start[4:5] >= bytes([PLAIN_HEADER]) and start.startswith(MAGIC):
        start += bytes(inflater.read(PLACES.size))
    header = read_header(path, start)
    if header.version >= PLAIN_HEADER:
        raise DataError(f"{path} is a damaged SPZ file: version 4 in gzip.", COPY_AGAIN)
    _check_announced(path, header, size, max(ALWAYS, RATIO * size))
    announced = sum(header.stream_sizes)
    further = MOST_EXTENSIONS if header.is_extended else 0
    content = inflater.read(announced + further + 1)
    if len(content) > announced + further:
        raise DataError(
            f"{path} is damaged: its header announces {header.count} splats, {announced} bytes, "
            "and more follow.",
            COPY_AGAIN,
        )
    return _split(path, header, content)


class _Inflater:
    """Decompression of gzip that stops at a number of bytes."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._path, self._file = path, file
        self._decoder = zlib.decompressobj(wbits=31)

    def read(self, count: int) -> bytearray:
        """The next bytes; fewer at the end of the stream.

        Raises:
            DataError: the stream is damaged, or the file ends before it.
        """
        content, decoder = bytearray(), self._decoder
        while len(content) < count and not decoder.eof:
            given = decoder.unconsumed_tail or self._file.read(PART)
            if not given:
                raise DataError(
                    f"{self._path} is cut short: its gzip stream does not end.", COPY_AGAIN
                )
            try:
                content += decoder.decompress(given, min(PART, count - len(content)))
            except zlib.error as error:
                raise DataError(
                    f"{self._path} is a damaged SPZ file: {error}.", COPY_AGAIN
                ) from None
        return content


def _split(
    path: Path, header: SpzHeader, content: bytes | bytearray
) -> tuple[SpzHeader, list[Bytes], Signs]:
    """The streams of versions 1 to 3, which follow one another."""
    ends = list(accumulate(header.stream_sizes))
    if len(content) < ends[-1]:
        raise DataError(
            f"{path} is cut short: its header announces {header.count} splats, {ends[-1]} bytes, "
            f"and {len(content)} follow.",
            COPY_AGAIN,
        )
    whole = np.frombuffer(content, dtype=np.uint8, count=ends[-1])
    records = bytes(content[ends[-1] :][:MOST_EXTENSIONS]) if header.is_extended else b""
    return header, np.split(whole, ends[:-1]), _stated_frame(path, records)


def _compressed_by_stream(
    path: Path, file: BinaryIO, header: SpzHeader, size: int
) -> tuple[SpzHeader, list[Bytes], Signs]:
    """Version 4."""
    check_available(f"{path}: SPZ of version 4")
    sizes = header.stream_sizes
    first = header.table + ENTRY.size * len(sizes)
    records = b""
    if header.is_extended:
        records = file.read(min(header.table - file.tell(), MOST_EXTENSIONS))
    file.seek(header.table)
    entries = list(ENTRY.iter_unpack(file.read(first - header.table))) if first <= size else []
    if not entries or first + sum(packed for packed, _ in entries) > size:
        raise DataError(f"{path} is cut short: its streams end behind the file.", COPY_AGAIN)
    if tuple(raw for _, raw in entries) != sizes:
        raise DataError(
            f"{path} is a damaged SPZ file: the sizes of its streams do not belong to "
            f"{header.count} splats of SH degree {header.degree}.",
            COPY_AGAIN,
        )
    streams = []
    for number, (packed, raw) in enumerate(entries):
        if raw > max(ALWAYS, RATIO * packed):
            _check_announced(path, header, size, 0)
        try:
            streams.append(np.frombuffer(decompressed(file.read(packed), raw), dtype=np.uint8))
        except DamagedStreamError as error:
            raise DataError(
                f"{path} is a damaged SPZ file: its stream {number + 1}: {error}.", COPY_AGAIN
            ) from None
    return header, streams, _stated_frame(path, records)


def _stated_frame(path: Path, records: bytes) -> Signs:
    """The signs of our axes in the frame that extension records state; else those of the format."""
    while len(records) >= RECORD.size:
        kind, length = RECORD.unpack_from(records)
        payload, records = records[RECORD.size :][:length], records[RECORD.size + length :]
        if kind != COORDINATES or len(payload) != 4:
            continue
        frame = int.from_bytes(payload, "little")
        if frame > LAST_MIRRORED:
            raise DataError(
                f"{path}: its stored frame (Adobe's record) has the axes in another order.",
                "Convert it with the tool that made it: the format's own frame is x right, y up, "
                "z back.",
            )
        if frame != UNSPECIFIED:
            right, up, front = (frame - 1 >> bit & 1 for bit in range(3))
            return (2.0 * right - 1, 1 - 2.0 * up, 2.0 * front - 1)
    return RDF_TO_RUB
