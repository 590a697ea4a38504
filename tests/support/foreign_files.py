"""Sound files as other tools write them, nearly all of five splats, for tests of damage."""

from __future__ import annotations

import base64
import gzip
import json
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from plyfile import PlyData

from gsfw.formats.compressed_ply import CompressedPlyExporter
from gsfw.formats.ply import PlyExporter
from gsfw.formats.sog.exporter import SogExporter
from gsfw.formats.spz.exporter import SpzExporter
from gsfw.formats.usd.exporter import UsdExporter
from gsfw.testing.sources import splat_file
from support.gltf_files import quantised, small, taken_apart, write
from support.ksplat_files import records, sections
from support.sog_files import legacy, unpacked

COUNT = 5
CHUNK = 256
"""Splats of chunk.compressed.ply: a whole chunk, so that multiples of both numbers agree."""
EXTENDED = 2
"""The flag of SPZ that says that records follow."""


def foreign_files(folder: Path) -> Iterator[Path]:
    """Files in a folder; what belongs to one lies beside it."""
    yield from _plys(folder)
    yield from _spzs(folder)
    yield from _ksplats(folder)
    yield from _gltfs(folder)
    yield from _sogs(folder)
    yield from _streamed_sogs(folder)
    yield from _usds(folder)


def _plys(folder: Path) -> Iterator[Path]:
    """Text and big-endian, plain and compressed; and a compressed one of a whole chunk."""
    CompressedPlyExporter().write(folder / "chunk.compressed.ply", splat_file(CHUNK))
    yield folder / "chunk.compressed.ply"
    for exporter in (PlyExporter(), CompressedPlyExporter()):
        source = folder / f"source{exporter.suffix}"
        exporter.write(source, splat_file(COUNT, 1))
        elements = PlyData.read(str(source)).elements
        for name, encoding in (("text", {"text": True}), ("big", {"byte_order": ">"})):
            path = folder / f"{name}{exporter.suffix}"
            PlyData(elements, **encoding).write(str(path))
            yield path


def _spzs(folder: Path) -> Iterator[Path]:
    """Version 1, a plain one, and extension records behind the streams and before the table."""
    header = struct.pack("<4sIIBBBB", b"NGSP", 1, COUNT, 0, 12, 0, 0)
    positions = np.linspace(-2, 2, 3 * COUNT).astype("<f2").tobytes()
    rest = bytes([128] * COUNT + [128] * 3 * COUNT + [100] * 3 * COUNT + [140] * 3 * COUNT)
    (folder / "one.spz").write_bytes(gzip.compress(header + positions + rest))
    yield folder / "one.spz"
    source = folder / "source.spz"
    record = struct.pack("<II3s", 0xADBE0002, 3, b"abc") + struct.pack("<III", 0xADBE0003, 4, 6)
    SpzExporter(version=3).write(source, splat_file(COUNT, 1))
    raw = bytearray(gzip.decompress(source.read_bytes()))
    (folder / "plain.spz").write_bytes(raw)
    yield folder / "plain.spz"
    raw[14] |= EXTENDED
    (folder / "extended.spz").write_bytes(gzip.compress(bytes(raw) + record))
    yield folder / "extended.spz"
    SpzExporter(version=4).write(source, splat_file(COUNT, 1))
    raw = bytearray(source.read_bytes())
    raw[14] |= EXTENDED
    raw[16:20] = struct.pack("<I", 32 + len(record))
    (folder / "extended4.spz").write_bytes(bytes(raw[:32]) + record + bytes(raw[32:]))
    yield folder / "extended4.spz"


def _ksplats(folder: Path) -> Iterator[Path]:
    """Two sections with full and partial buckets, in the levels that have buckets."""
    for level in (1, 2):
        first = (0, 1, 1, [1], [[1, 1, 1], [2, 2, 2]], records(level, 0, 2))
        second = (3, 256, 0, [2, 1], [[7, 7, 7], [8, 8, 8]], records(level, 3, 3))
        path = folder / f"sections{level}.ksplat"
        path.write_bytes(sections(level, [first, second]))
        yield path


def _gltfs(folder: Path) -> Iterator[Path]:
    """Nodes in one another, with the buffer in the JSON and in a file beside it."""
    nodes = [
        {"rotation": [0.6, 0, 0, 0.8], "translation": [1, 2, 3], "children": [1]},
        {"scale": [2, 1, 0.5], "children": [2]},
        {"mesh": 0, "matrix": [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 4, 5, 6, 1]},
    ]
    document, binary = quantised(small(COUNT))
    inline = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    document["buffers"][0]["uri"] = inline
    (folder / "inline.gltf").write_text(json.dumps({**document, "nodes": nodes}))
    yield folder / "inline.gltf"
    document, binary = taken_apart(write(folder / "source.glb", splat_file(COUNT, 1)))
    (folder / "beside.bin").write_bytes(binary)
    document["buffers"][0]["uri"] = "beside.bin"
    (folder / "beside.gltf").write_text(json.dumps({**document, "nodes": nodes}))
    yield folder / "beside.gltf"


def _sogs(folder: Path) -> Iterator[Path]:
    """A folder of version 2, and one of version 1."""
    source = folder / "source.sog"
    SogExporter().write(source, splat_file(COUNT, 1))
    yield unpacked(source, folder / "sog") / "meta.json"
    legacy(folder / "old", range(COUNT))
    yield folder / "old" / "meta.json"


def _streamed_sogs(folder: Path) -> Iterator[Path]:
    """Three splats of a file and two of another one, which an older index names; archives."""
    for name in "01":
        SogExporter().write(folder / f"{name}.sog", splat_file(COUNT, int(name)))
    regions = [{"file": 0, "offset": 1, "count": 3}, {"file": 1, "offset": 0, "count": 2}]
    leaves = [{"lods": {"0": finest, "1": regions[0]}} for finest in regions]
    index = {"lodLevels": 2, "filenames": ["0.sog", "1.sog"], "tree": {"children": leaves}}
    (folder / "older.json").write_text(json.dumps(index))
    yield folder / "older.json"


def _usds(folder: Path) -> Iterator[Path]:
    """A stage as text, and one in a package."""
    for name in ("text.usda", "package.usdz"):
        UsdExporter().write(folder / name, splat_file(COUNT, 1))
        yield folder / name
