"""Bombs: small files whose compressed parts unpack to far more than their headers justify."""

from __future__ import annotations

import gzip
import io
import json
import lzma
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from importlib.util import find_spec

from PIL import Image

from support.damage import GZIP, XZ, ZIP

SIZE = 1 << 26
"""Bytes that a part unpacks to, beyond its own."""
PART = bytes(1 << 20)
SIDE = 4096
"""Side of an image of one colour: 67 MB."""
STREAMS = 16_000_000
"""Splats that the header of an SPZ of version 4 announces; their positions take 144 MB."""


def bombs(whole: bytes) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Bombs made of a sound file: what each is, and what makes it; none if it is not compressed."""
    if whole.startswith(GZIP):
        yield "a gzip stream that goes on", partial(_stream, whole)
    if whole.startswith(ZIP):
        yield from _in_archive(whole)
    if whole.startswith(b"NGSP\4") and find_spec("backports.zstd") is not None:
        yield "streams of Zstandard whose sizes agree", partial(_streams, whole)


def _stream(whole: bytes) -> bytes:
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    parts = [packer.compress(gzip.decompress(whole))]
    parts += [packer.compress(PART) for _ in range(SIZE // len(PART))]
    return b"".join([*parts, packer.flush()])


def _in_archive(whole: bytes) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Entries that go on, headers that go on, and images of one colour."""
    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    first, last = next(iter(members)), [*members][-1]
    yield "a header that goes on", partial(_longer, members, first, b" ")
    yield "an entry that goes on", partial(_longer, members, last, b"\0")
    if members[first].startswith(XZ):
        yield "a header in XZ that goes on", partial(_longer_in_xz, members, first)
    if "meta.json" in members:
        yield "images of one colour whose sizes agree", partial(_large_images, members)


def _longer(members: Mapping[str, bytes], name: str, more: bytes) -> bytes:
    return _archived({**members, name: members[name] + more * SIZE}, zipfile.ZIP_DEFLATED)


def _longer_in_xz(members: Mapping[str, bytes], name: str) -> bytes:
    text = b" " * SIZE + lzma.decompress(members[name])
    return _archived({**members, name: lzma.compress(text, preset=0)})


def _archived(members: Mapping[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", method) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return made.getvalue()


def _large_images(members: Mapping[str, bytes]) -> bytes:
    """A SOG of as many equal splats as a large image of one colour has texels."""
    made = io.BytesIO()
    Image.new("RGBA", (SIDE, SIDE), (0, 0, 0, 255)).save(made, "WEBP", lossless=True, method=0)
    meta = {**json.loads(members["meta.json"]), "count": SIDE * SIDE}
    images = {name: made.getvalue() for name in members if name.endswith(".webp")}
    return _archived({"meta.json": json.dumps(meta).encode(), **images})


def _streams(whole: bytes) -> bytes:
    """An SPZ of version 4 whose streams are zeros."""
    from backports.zstd import ZstdCompressor

    version, degree_on = whole[:8], whole[12:14] + b"\0" + whole[15:16]
    widths = (9, 1, 3, 3, 4, *((9,) if whole[12] else ()))
    streams = []
    for width in widths:
        packer = ZstdCompressor(level=1)
        parts = [packer.compress(PART) for _ in range(width * STREAMS // len(PART))]
        parts += [packer.compress(bytes(width * STREAMS % len(PART))), packer.flush()]
        streams.append(b"".join(parts))
    header = version + struct.pack("<I", STREAMS) + degree_on + struct.pack("<I12x", 32)
    table = [
        struct.pack("<QQ", len(stream), width * STREAMS)
        for stream, width in zip(streams, widths, strict=True)
    ]
    return b"".join([header, *table, *streams])
