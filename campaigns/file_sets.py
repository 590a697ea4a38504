"""File sets: the sound files that a reader is given together, and changes of one of them.

A data set is a folder, of which one file is damaged at a time. The others stay as they are, so that
readers go on to what depends on the damaged one.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from random import Random

from support.damage import damaged, renamed

STRUCTURE = 0.03
"""Share of the changes that remove a file, or put a folder or a link in its place."""
NAMES = 0.12
"""Share of the changes that replace a name within a file."""


@dataclass(frozen=True)
class FileSet:
    """Sound files of one data set."""

    label: str
    files: Mapping[str, bytes]
    """Contents by path within the folder, with forward slashes."""
    entry: str = "."
    """The path that readers are given: the folder, or a file in it."""
    targets: tuple[str, ...] = ()
    """Files that are damaged; all of them if empty."""

    @classmethod
    def of(
        cls, label: str, folder: Path, entry: str = ".", targets: tuple[str, ...] = ()
    ) -> FileSet:
        """Take the files of a folder."""
        found = sorted(path for path in folder.rglob("*") if path.is_file())
        files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}
        return cls(label, files, entry, targets)

    @property
    def damageable(self) -> tuple[str, ...]:
        """Files that are damaged, each content once."""
        if self.targets:
            return self.targets
        return tuple({self.files[name]: name for name in self.files}.values())

    def write(self, folder: Path) -> None:
        """Write the files into a folder, in place of what it has."""
        shutil.rmtree(folder, ignore_errors=True)
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


@dataclass(frozen=True)
class Damage:
    """A change of one file of a set."""

    name: str
    content: bytes | None
    """The file's new bytes; ``None`` if something else stands in its place."""
    other: str = ""
    """Its new content: "nothing", "folder", "outside" (a link out of the folder) or "itself"."""

    def __str__(self) -> str:
        what = self.other or f"{len(self.content or b'')} bytes"
        return f"{self.name} ({what})"


def damage(files: FileSet, name: str, source: bytes, seed: int) -> Damage:
    """The change that a seed names.

    Args:
        files: sound files, of which parts may be taken.
        name: the file that is changed.
        source: its content, sound or changed before.
        seed: names the change.
    """
    random = Random(seed)
    if random.random() < STRUCTURE:
        return Damage(name, None, random.choice(("nothing", "folder", "outside", "itself")))
    if random.random() < NAMES:
        return Damage(name, renamed(random, source))
    others = [content for other, content in files.files.items() if other != name][:8]
    return Damage(name, damaged(source, others, seed))


@contextmanager
def applied(folder: Path, files: FileSet, change: Damage) -> Iterator[int]:
    """Have a change in a folder that holds the sound files; gives the bytes of the changed file."""
    path = folder / change.name
    path.unlink()
    _PLACES[change.other](path, change.content or b"")
    try:
        yield len(change.content or b"")
    finally:
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
        else:
            path.unlink(missing_ok=True)
        path.write_bytes(files.files[change.name])


def _link(path: Path, target: str) -> None:
    if hasattr(os, "symlink"):
        path.symlink_to(target)


_PLACES: Mapping[str, Callable[[Path, bytes], object]] = {
    "": lambda path, content: path.write_bytes(content),
    "nothing": lambda path, _: None,
    "folder": lambda path, _: path.mkdir(),
    "outside": lambda path, _: _link(path, "/proc/self/status"),
    "itself": lambda path, _: _link(path, path.name),
}
