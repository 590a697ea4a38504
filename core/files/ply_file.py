"""PLY files: a header names elements and their properties, then the rows of each element follow.

G. Turk, The PLY Polygon File Format (1994). Rows are read part by part, from text and from both
byte orders. Elements with lists, such as faces, are skipped; rows of fixed size are read.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path

import numpy as np
from jaxtyping import Shaped

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.files.reading import check_downloaded, first_bytes, readable

MAX_HEADER = 1 << 16
"""Longest header in bytes; the longest known layout of splats has 3,000."""
ROWS = 1 << 15
"""Rows of a part: 8 MB for splats of degree 3."""
ENCODINGS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
"""Byte orders of numpy by the name of the encoding; none for text."""
KINDS = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
"""Types of numpy by those of a header: of 1994, and of later tools."""

Rows = Shaped[np.ndarray, " n"]
"""Rows of one element: a structured array, with the properties as fields."""


@dataclass
class PlyElement:
    """One kind of rows."""

    name: str
    count: int
    """Number of rows that the header announces."""
    kinds: dict[str, str] = field(default_factory=dict)
    """The type of each property, as numpy names it; of a list, that of its length."""
    lists: set[str] = field(default_factory=set)
    """The properties that are lists."""

    def dtype(self, order: str) -> np.dtype[np.void]:
        """The type of a row without lists, in a byte order of numpy."""
        return np.dtype([(name, order + kind) for name, kind in self.kinds.items()])

    def least_bytes(self, order: str) -> int:
        """Least size of all rows: a number in a text has a digit and a blank, a list its length."""
        if not order:
            return 2 * len(self.kinds) * self.count
        return sum(np.dtype(kind).itemsize for kind in self.kinds.values()) * self.count


@dataclass(frozen=True)
class PlyHeader:
    """The header of a file; nothing of its rows is read yet."""

    path: Path
    order: str
    """Byte order of numpy; empty for text."""
    comments: tuple[str, ...]
    elements: Mapping[str, PlyElement]
    """By name, in the order of the file."""
    start: int
    """Bytes before the first row."""

    def names(self, element: str) -> frozenset[str]:
        """Names of the properties of an element; none if the file does not have it."""
        return frozenset(self.elements[element].kinds) if element in self.elements else frozenset()

    def rows(self, name: str) -> Iterator[Rows]:
        """The rows of an element, part by part.

        The file is checked when this is called: after it, as many rows as the header announces may
        be allocated.

        Raises:
            DataError: the file is shorter than its header announces, the element has lists, or
                some stand before it in a binary file; later, a row of a text is malformed.
        """
        announced = sum(item.least_bytes(self.order) for item in self.elements.values())
        after = self.path.stat().st_size - self.start
        # The last number of a text needs no blank after it.
        if announced > after + (not self.order):
            raise self._cut_short(announced, after)
        element = self.elements[name]
        before = list(self.elements.values())[: list(self.elements).index(name)]
        lists = element.lists or (self.order and any(item.lists for item in before))
        if lists or not element.kinds:
            raise DataError(
                f"{self.path}: the rows of its element {name!r} cannot be found: lists, such as "
                "faces, stand among or before them.",
                "Save it with another program, such as MeshLab, without faces.",
            )
        if self.order:
            skipped = sum(item.least_bytes(self.order) for item in before)
            return self._binary(element, self.start + skipped)
        # Rows without properties are no lines; of others, the file was found to have room for all.
        return self._text(element, sum(item.count for item in before if item.kinds))

    def _cut_short(self, announced: int, found: int) -> DataError:
        rows = ", ".join(f"{item.count} {item.name}" for item in self.elements.values())
        return DataError(
            f"{self.path} is cut short: its header announces {rows} rows, at least {announced} "
            f"bytes, and {found} follow.",
            COPY_AGAIN,
        )

    def _binary(self, element: PlyElement, offset: int) -> Iterator[Rows]:
        kind = element.dtype(self.order)
        with self.path.open("rb") as file:
            file.seek(offset)
            for count in _lengths(element.count):
                # Not mapped: mapped pages count as memory of the process.
                rows = np.fromfile(file, kind, count)
                if len(rows) < count:
                    raise self._cut_short(count * kind.itemsize, rows.nbytes)
                yield rows

    def _text(self, element: PlyElement, skipped: int) -> Iterator[Rows]:
        with self.path.open("rb") as file:
            file.seek(self.start)
            text = io.TextIOWrapper(file, encoding="latin-1")
            lines = islice((line for line in text if not line.isspace()), skipped, None)
            first = 0
            for count in _lengths(element.count):
                part = list(islice(lines, count))
                yield _parsed(self.path, element, part, first, count)
                first += count


def _lengths(count: int) -> Iterator[int]:
    """Lengths of the parts of ``count`` rows."""
    return (min(ROWS, count - first) for first in range(0, count, ROWS))


def _parsed(path: Path, element: PlyElement, lines: Sequence[str], first: int, count: int) -> Rows:
    """The rows of some lines of text."""
    rows = np.empty(count, element.dtype("="))
    try:
        table = np.loadtxt(lines, dtype=np.float64, comments=None, ndmin=2) if lines else rows
        if table.shape != (count, len(element.kinds)):
            raise ValueError("other numbers of rows or columns")
        for number, (name, kind) in enumerate(element.kinds.items()):
            column = table[:, number]
            if np.dtype(kind).kind != "f":
                limits = np.iinfo(kind)
                if not ((column >= limits.min) & (column <= limits.max)).all():
                    raise ValueError("out of range")
            with np.errstate(over="ignore"):
                rows[name] = column
    except ValueError as error:
        cause = (
            _malformed(element, lines, first)
            or f"{element.name} row {first + len(lines)} is missing"
        )
        raise DataError(f"{path} is a damaged PLY: {cause}.", COPY_AGAIN) from error
    return rows


def _malformed(element: PlyElement, lines: Sequence[str], first: int) -> str | None:
    """The first line that is no row of an element, in words."""
    for row, line in enumerate(lines, first):
        words = line.split()
        if len(words) != len(element.kinds):
            return f"{element.name} row {row} has {len(words)} values, not {len(element.kinds)}"
        for word, (name, kind) in zip(words, element.kinds.items(), strict=True):
            try:
                value = float(word)
            except ValueError:
                return f"{element.name} row {row}: {name} is {word[:40]!r}, which is no number"
            if kind[0] != "f" and not np.iinfo(kind).min <= value <= np.iinfo(kind).max:
                return f"{element.name} row {row}: {name} is {word[:40]}, which is out of range"
    return None


def is_ply(path: Path) -> bool:
    """True if a file begins as a PLY does; never raises."""
    return first_bytes(path, 4) in (b"ply\n", b"ply\r")


def read_ply_header(path: Path) -> PlyHeader:
    """Read the header of a file, and nothing more.

    Raises:
        DataError: it is no PLY, or damaged; names the line.
    """
    with readable(path), path.open("rb") as file:
        start = file.read(MAX_HEADER)
    opening = re.match(rb"ply(\r\n|\n|\r)", start)
    if opening is None:
        check_downloaded(path)
        raise DataError(f"{path} is not a PLY file: it does not begin with 'ply'.")
    line_break = opening[1]
    head, ending, _ = start.partition(line_break + b"end_header" + line_break)
    if not ending:
        raise DataError(f"{path} is a damaged PLY: its header does not end.", COPY_AGAIN)
    lines = head.decode("utf-8", "replace").split(line_break.decode())
    return _parsed_header(path, lines, len(head) + len(ending))


def _parsed_header(path: Path, lines: Sequence[str], start: int) -> PlyHeader:
    """The header of some lines, of which the first is ``ply``."""
    orders: list[str] = []
    comments: list[str] = []
    elements: dict[str, PlyElement] = {}
    for number, line in enumerate(lines[1:], 2):
        try:
            match line.split():
                case ["comment" | "obj_info", *_]:
                    comments.append(line.partition(" ")[2].strip())
                case ["format", encoding, "1.0"] if encoding in ENCODINGS and not orders:
                    orders.append(ENCODINGS[encoding])
                case ["element", name, count] if name not in elements:
                    elements[name] = PlyElement(name, _number(count))
                case ["property", *words]:
                    _add_property(elements, words)
                case _:
                    raise ValueError(f"{line[:80]!r} is no statement that is expected there")
        except ValueError as error:
            raise DataError(
                f"{path} is a damaged PLY: line {number}: {error}.", COPY_AGAIN
            ) from None
    if not orders:
        raise DataError(f"{path} is a damaged PLY: its header states no format.", COPY_AGAIN)
    return PlyHeader(path, orders[0], tuple(comments), elements, start)


def _number(text: str) -> int:
    if not re.fullmatch(r"[0-9]{1,18}", text):
        raise ValueError(f"expected a number of rows, found {text[:40]!r}")
    return int(text)


def _add_property(elements: dict[str, PlyElement], words: Sequence[str]) -> None:
    """Add a property to the last element.

    Raises:
        ValueError: it is of an unknown type, is there already, or belongs to no element.
    """
    is_list = len(words) == 4 and words[0] == "list"
    if not elements or not (is_list or len(words) == 2):
        raise ValueError("expected an element, or a property with a type and a name")
    for kind in words[:-1][is_list:]:
        if kind not in KINDS:
            raise ValueError(f"{kind[:40]!r} is no type")
    element, name = list(elements.values())[-1], words[-1]
    if name in element.kinds:
        raise ValueError(f"{element.name} has {name!r} twice")
    element.kinds[name] = KINDS[words[1] if is_list else words[0]]
    if is_list:
        element.lists.add(name)


def ply_header(
    comments: Iterable[str], elements: Mapping[str, tuple[int, Sequence[tuple[str, str]]]]
) -> bytes:
    """The header of a binary, little-endian file.

    Args:
        comments: one line each.
        elements: by name: the number of rows, and the types and names of the properties; that of
            a list is "list uchar int".
    """
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {text}" for text in comments)]
    for name, (count, properties) in elements.items():
        lines.append(f"element {name} {count}")
        lines += [f"property {kind} {name}" for kind, name in properties]
    return "\n".join([*lines, "end_header", ""]).encode()
