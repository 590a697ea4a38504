"""Metadata of 360-degree videos: boxes of Spherical Video, versions 1 and 2, in an MP4 file."""

import struct
from pathlib import Path

XMP = b"".join(
    b"<GSpherical:%s>%s</GSpherical:%s>" % (name, value, name)
    for name, value in (
        (b"Spherical", b"true"),
        (b"Stitched", b"true"),
        (b"StitchingSoftware", b"tests"),
        (b"ProjectionType", b"equirectangular"),
    )
)
TRACK = (b"moov", b"trak")
ENTRIES = (*TRACK, b"mdia", b"minf", b"stbl", b"stsd")
ENTRIES_HEAD = 8
"""Bytes of stsd before its boxes."""


def box(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), kind) + content


def _projection(kind: bytes, content: bytes) -> bytes:
    head = box(b"svhd", bytes(5)) + box(b"proj", box(b"prhd", bytes(16)) + box(kind, content))
    return box(b"sv3d", head)


WHOLE = _projection(b"equi", bytes(20))
QUARTER = _projection(b"equi", struct.pack(">5I", 0, 1 << 30, 0, 1 << 28, 0))
CUBE = _projection(b"cbmp", bytes(12))
TOP_BOTTOM = box(b"st3d", bytes(4) + b"\1")


def state_in_entry(path: Path, boxes: bytes) -> None:
    """Add boxes of version 2 to the description of the images."""
    content = path.read_bytes()
    entry = content.index(b"stsd") + 4 + ENTRIES_HEAD + 4
    path.write_bytes(_with(content, (*ENTRIES, content[entry : entry + 4]), boxes))


def state_in_xmp(path: Path) -> None:
    """Add the XMP data of version 1."""
    number = bytes.fromhex("ffcc8263f8554a938814587a02521fdd")
    path.write_bytes(_with(path.read_bytes(), TRACK, box(b"uuid", number + XMP)))


def _with(content: bytes, path: tuple[bytes, ...], boxes: bytes) -> bytes:
    """Boxes that go to the end of the box at a path; sample data must come before it."""
    result, start = b"", 0
    while start < len(content):
        size, kind = struct.unpack(">I4s", content[start : start + 8])
        inside = content[start + 8 : start + size]
        if kind == path[0]:
            head = ENTRIES_HEAD if kind == b"stsd" else 0
            rest = _with(inside[head:], path[1:], boxes) if path[1:] else inside[head:] + boxes
            result += box(kind, inside[:head] + rest)
        else:
            result += content[start : start + size]
        start += size
    return result
