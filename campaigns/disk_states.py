"""Disk states: what may be on a disk after a power loss, from a log of file operations.

Data and names reach the disk only with fsync: of a file its data, of a folder the names in it. What
was not synchronised may be there, be lost, or be zeros, and later operations may be there without
earlier ones (Pillai et al., All File Systems Are Not Created Equal, OSDI 2014).
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import TypeVar


@dataclass(frozen=True)
class Operation:
    """An operation on a file, as ``file_faults.c`` records it."""

    kind: str
    """create, write, truncate, fsync, rename, link, unlink, mkdir, rmdir or mark."""
    file: int = 0
    """Inode number of an open file."""
    place: int = 0
    """Byte at which a write begins, or the length that is left."""
    path: str = ""
    """Path of a name, or the text of a mark."""
    other: str = ""
    """New path of a rename or a link."""
    data: bytes = b""


def read_log(path: Path) -> list[Operation]:
    """The operations of a log, in order."""
    content, position, found = path.read_bytes(), 0, []
    while position < len(content):
        end = content.index(b"\n", position)
        kind, file, place, length, name, other = content[position:end].decode().split("\t")
        data = content[end + 1 : end + 1 + int(length)]
        found.append(Operation(kind, int(file), int(place), name, other, data))
        position = end + 1 + int(length)
    return found


class Fate(Enum):
    """Fate of what was not synchronised."""

    THERE = "all is there"
    LOST = "all is lost"
    DATA_LOST = "names are there, data is lost"
    ZEROS = "names are there, data is zeros"
    NAMES_LOST = "data is there, names are lost"
    SOME = "some operations of each kind are there"
    UNORDERED = "any operations are there, in any order"


Pending = TypeVar("Pending")


def _left(
    pending: Sequence[Pending], fate: Fate, lost: Fate, draw: random.Random
) -> Sequence[Pending]:
    """Pending operations that a power loss leaves done; none for ``lost``."""
    if fate in (Fate.LOST, lost):
        return ()
    if fate is Fate.SOME:
        return pending[: draw.randint(0, len(pending))]
    if fate is Fate.UNORDERED:
        return [item for item in pending if draw.random() < 0.5]
    return pending


@dataclass
class _File:
    """Data of a file: synchronised, and pending writes and truncations after it."""

    kept: bytearray = field(default_factory=bytearray)
    pending: list[Operation] = field(default_factory=list)

    def content(self, fate: Fate, draw: random.Random) -> bytes:
        content = bytearray(self.kept)
        for item in _left(self.pending, fate, Fate.DATA_LOST, draw):
            _apply(content, item, is_zero=fate is Fate.ZEROS)
        return bytes(content)

    def synchronise(self) -> None:
        for item in self.pending:
            _apply(self.kept, item)
        self.pending.clear()


def _apply(content: bytearray, item: Operation, is_zero: bool = False) -> None:
    if item.kind == "truncate":
        del content[item.place :]
        content.extend(bytes(item.place - len(content)))
        return
    content.extend(bytes(max(0, item.place - len(content))))
    content[item.place : item.place + len(item.data)] = bytes(len(item.data)) * is_zero or item.data


FOLDER = -1
"""Stands for the file of a name that is a folder."""


@dataclass(frozen=True)
class _Change:
    """A change of names in a folder, which is there as a whole or not at all."""

    folder: str
    names: tuple[tuple[str, int | None], ...]
    """Paths, and the number of the file of each; ``None`` for none."""


class Disk:
    """A disk to which operations are applied, one after another."""

    def __init__(self) -> None:
        self._files: list[_File] = []
        self._open: dict[int, int] = {}
        """Number of the file of each inode."""
        self._names: dict[str, int | None] = {}
        """All names, as programs see them."""
        self._kept: dict[str, int | None] = {}
        """Names that are synchronised."""
        self._pending: list[_Change] = []
        self.marks: list[str] = []
        """Output that the program has reported by now."""

    def apply(self, item: Operation) -> None:
        """Apply the next operation."""
        if item.kind == "mark":
            self.marks.append(item.path)
        elif item.kind in ("write", "truncate"):
            self._file(item.file).pending.append(item)
        elif item.kind == "fsync":
            self._synchronise(item)
        else:
            self._change(item)

    def _file(self, inode: int) -> _File:
        if inode not in self._open:  # One that was there before, or has no name.
            self._open[inode] = len(self._files)
            self._files.append(_File())
        return self._files[self._open[inode]]

    def _synchronise(self, item: Operation) -> None:
        if self._names.get(item.path) != FOLDER and item.file in self._open:
            self._file(item.file).synchronise()
            return
        left = []
        for change in self._pending:
            if change.folder == item.path:
                self._kept.update(change.names)
            else:
                left.append(change)
        self._pending = left

    def _change(self, item: Operation) -> None:
        path, names = item.path, []
        if item.kind == "create":
            self._open.pop(item.file, None)  # The number of a removed file may come again.
            self._file(item.file)
            names = [(path, self._open[item.file])]
        elif item.kind == "mkdir":
            names = [(path, FOLDER)]
        elif item.kind in ("unlink", "rmdir"):
            names = [(path, None)]
        elif item.kind == "rename":
            names = [(path, None), (item.other, self._names.get(path))]
        elif item.kind == "link":
            path, names = item.other, [(item.other, self._names.get(path))]
        self._names.update(names)
        target = item.other or path
        self._pending.append(_Change(str(Path(target).parent), tuple(names)))

    def state(self, fate: Fate, draw: random.Random) -> dict[str, bytes | None]:
        """Files that are there after a power loss now: content by path; ``None``: a folder."""
        names = dict(self._kept)
        for change in _left(self._pending, fate, Fate.NAMES_LOST, draw):
            names.update(change.names)
        found: dict[str, bytes | None] = {}
        for path in sorted(names):
            file, parent = names[path], str(Path(path).parent)
            if file is None or (parent in self._names and parent not in found):
                continue
            found[path] = None if file == FOLDER else self._files[file].content(fate, draw)
        return found


def write_state(state: dict[str, bytes | None], root: Path, place: Path) -> None:
    """Write the files of a state below another folder.

    Args:
        state: as of ``Disk.state``.
        root: folder of its paths.
        place: in which they are written.
    """
    for path, content in state.items():
        target = place / Path(path).relative_to(root)
        if content is None:
            target.mkdir(parents=True, exist_ok=True)
        else:
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)


def states(
    operations: Sequence[Operation], size: int, draw: random.Random
) -> Iterator[tuple[int, Fate, list[str], dict[str, bytes | None]]]:
    """States after a power loss at random operations, each of them with every fate.

    Yields:
        Number of operations before the loss, fate, what was reported, and the files.
    """
    points = sorted(draw.randint(0, len(operations)) for _ in range(-(-size // len(Fate))))
    disk, done = Disk(), 0
    for point in points:
        for item in operations[done:point]:
            disk.apply(item)
        done = point
        for fate in Fate:
            yield point, fate, list(disk.marks), disk.state(fate, draw)
