"""File of a tree, read by chunks: what a view needs, within a bound of memory.

After 8 bytes ``GSFWLOD1``, a uint32 and a JSON header of that length come, little-endian and from
the next multiple of 64 bytes on, the places of all nodes (float32) and then their Gaussians, each
with 14 numbers in float32 and its other coefficients in float16 (``gsfw.lod.nodes``). Both are in
the order of the nodes' numbers. A chunk is 1024 nodes of either.
"""

from __future__ import annotations

import json
from collections import OrderedDict
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
import torch
from jaxtyping import Float32, Int, Int64, UInt8
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.core.files.atomic import atomic_file
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.json_text import parsed_json
from gsfw.core.files.reading import first_bytes, readable
from gsfw.core.maths.axes import stated_axis
from gsfw.core.maths.spherical_harmonics import MAX_DEGREE
from gsfw.lod.nodes import BYTES, PLACE, VALUES, Nodes, Tree, TreeInMemory

MAGIC = b"GSFWLOD1"
ALIGNMENT = 64
CHUNK = 1024
"""Nodes that are read at once: 150 kB at degree 3."""
PART = 1 << 16
"""Nodes that are written at once."""
MOST_HEADER = 1 << 16
"""Bytes of the longest header: a damaged length is no reason to reserve memory."""
FARTHEST = float(np.finfo(np.float32).max)
"""Largest coordinate of an origin: positions in the world have to fit into float32."""
AGAIN = "Copy it again, or write it again: gsfw export RUN format=lod"
"""The advice where a file is damaged."""


@dataclass(frozen=True)
class Header:
    """The facts about a tree."""

    count: int
    """Gaussians of the model."""
    sh_degree: int
    origin: tuple[float, float, float]
    """Added to the means: map coordinates need float64."""
    antialiased: bool = False
    up: str = ""


def write_tree(path: Path, tree: TreeInMemory, header: Header) -> None:
    """Write a tree atomically.

    Raises:
        OutputError: it cannot be written.
    """
    text = json.dumps(asdict(header)).encode()
    start = MAGIC + len(text).to_bytes(4, "little") + text
    with atomic_file(path) as file:
        file.write(start + b"\0" * (-len(start) % ALIGNMENT))
        file.write(np.ascontiguousarray(tree.all_places.numpy(), "<f4").data)
        for first in range(0, tree.num_nodes, PART):
            rows = slice(first, first + PART)
            values = tree.all_nodes.values[rows].numpy().astype("<f4").view(np.uint8)
            rest = tree.all_nodes.rest[rows].numpy().astype("<f2").view(np.uint8)
            file.write(np.concatenate([values, rest.reshape(len(values), -1)], axis=1).data)


def is_tree(path: Path) -> bool:
    """True if a file begins as a tree does."""
    return first_bytes(path, len(MAGIC)) == MAGIC


class TreeFile(Tree):
    """A tree in a file, of which chunks are read as they are needed."""

    def __init__(self, path: Path, memory: int) -> None:
        """Open the file, and read its header.

        Args:
            path: the file.
            memory: most bytes of chunks that are kept; those used last stay. One is always kept.

        Raises:
            DataError: it is damaged, or no tree.
        """
        self.path, self.memory = path, memory
        self.header, self._first = _header(path)
        self.count, self.sh_degree = self.header.count, self.header.sh_degree
        nodes = self._first + self.num_nodes * PLACE * BYTES
        self._sections = ((self._first, PLACE * BYTES), (nodes, self.node_bytes))
        expected = nodes + self.num_nodes * self.node_bytes
        if path.stat().st_size != expected:
            raise DataError(
                f"{path} has {path.stat().st_size:,} bytes, and its header announces "
                f"{expected:,}: it is cut off, or damaged.",
                AGAIN,
            )
        self._held: OrderedDict[tuple[int, int], np.ndarray[Any, Any]] = OrderedDict()
        self._lock = Lock()
        self.held = self.most_held = self.bytes_read = 0
        """Bytes of the chunks in memory, the most there ever were, and all that were read."""

    def places(self, numbers: Int[Tensor, " m"]) -> Float32[Tensor, "m 8"]:
        """Read those that are not held."""
        return _places(self._rows(0, numbers))

    def nodes(self, numbers: Int[Tensor, " m"]) -> Nodes:
        """Read those that are not held."""
        return _nodes(self._rows(1, numbers))

    def _rows(self, section: int, numbers: Int[Tensor, " m"]) -> UInt8[np.ndarray, "m b"]:
        """Rows of a section; fast for ascending numbers."""
        wanted: Int64[np.ndarray, " m"] = numbers.numpy()
        found = np.empty((len(wanted), self._sections[section][1]), np.uint8)
        chunks = wanted // CHUNK
        cuts = np.flatnonzero(np.diff(chunks)) + 1
        for first, end in zip([0, *cuts], [*cuts, len(wanted)], strict=True):
            if first < end:
                chunk = int(chunks[first])
                held = self._chunk(section, chunk)
                np.take(held, wanted[first:end] - chunk * CHUNK, axis=0, out=found[first:end])
        return found

    def _chunk(self, section: int, chunk: int) -> UInt8[np.ndarray, "k b"]:
        """A chunk, read unless it is held; the one that was used longest ago makes room."""
        key = (section, chunk)
        with self._lock:
            if key in self._held:
                self._held.move_to_end(key)
                return self._held[key]
            start, width = self._sections[section]
            size = min(CHUNK, self.num_nodes - chunk * CHUNK) * width
            while self._held and self.held + size > self.memory:
                self.held -= self._held.popitem(last=False)[1].nbytes
            with readable(self.path), self.path.open("rb") as file:
                file.seek(start + chunk * CHUNK * width)
                content = np.fromfile(file, np.uint8, size)
            if len(content) != size:
                raise DataError(f"{self.path} has become shorter.", "Open it again.")
            read = content.reshape(-1, width)
            self._check(section, chunk, read)
            self._held[key] = read
            self.held, self.bytes_read = self.held + size, self.bytes_read + size
            self.most_held = max(self.most_held, self.held)
            return read

    def _check(self, section: int, chunk: int, rows: UInt8[np.ndarray, "k b"]) -> None:
        """Refuse values that no writer writes.

        Raises:
            DataError: a value is not finite, or out of range.
        """
        sound = _nodes(rows).sound() if section else _places(rows).isfinite().all(dim=1)
        if not bool(sound.all()):
            node = chunk * CHUNK + int(sound.int().argmin())
            raise DataError(
                f"{self.path} is damaged: node {node:,} has values that are not finite, or out of "
                "range.",
                AGAIN,
            )


def _places(rows: UInt8[np.ndarray, "m b"]) -> Float32[Tensor, "m 8"]:
    """The places that bytes of a file hold."""
    return torch.from_numpy(rows.view("<f4").astype(np.float32, copy=False))


def _nodes(rows: UInt8[np.ndarray, "m b"]) -> Nodes:
    """The Gaussians that bytes of a file hold."""
    split = VALUES * BYTES
    # ascontiguousarray keeps the stride of a single row, which torch takes in whole elements only.
    values = rows[:, :split].copy().view("<f4").astype(np.float32, copy=False)
    halves = (
        rows[:, split:].copy().view("<f2").astype(np.float16, copy=False).reshape(len(rows), -1)
    )
    return Nodes(torch.from_numpy(values), torch.from_numpy(halves))


def _header(path: Path) -> tuple[Header, int]:
    """The header of a tree, and the place of what follows.

    Raises:
        DataError: it is damaged.
    """
    with readable(path), path.open("rb") as file:
        start = file.read(len(MAGIC) + 4)
        length = int.from_bytes(start[len(MAGIC) :], "little")
        if start[: len(MAGIC)] != MAGIC or length > min(MOST_HEADER, path.stat().st_size):
            raise DataError(f"{path} is no tree of levels of detail, or damaged.", AGAIN)
        text = file.read(length)
    try:
        document = parsed_json(text)
    except ValueError as error:
        raise DataError(f"{path} is damaged: its header is no JSON.", AGAIN) from error
    if not isinstance(document, dict):
        raise DataError(f"{path} is damaged: its header is no object.", AGAIN)
    first = len(start) + length
    return _checked(JsonFields(path, "", document, AGAIN)), first + -first % ALIGNMENT


def _checked(fields: JsonFields) -> Header:
    """The header of a document.

    Raises:
        DataError: a value is missing, of another type, or out of range.
    """
    degree = fields.count("sh_degree")
    if degree > MAX_DEGREE:
        raise fields.refuse("sh_degree", f"a degree of at most {MAX_DEGREE}")
    x, y, z = fields.numbers("origin", 3).tolist()
    if max(abs(x), abs(y), abs(z)) > FARTHEST:
        raise fields.refuse("origin", "coordinates that float32 holds")
    return Header(
        count=fields.count("count", least=1),
        sh_degree=degree,
        origin=(x, y, z),
        antialiased=fields.flag("antialiased"),
        up=stated_axis(fields.text("up")),
    )
