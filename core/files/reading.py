"""Reading: what a path leads to, and errors of the file system as messages for the user."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gsfw.core.errors import DataError

LFS_POINTER = b"version https://git-lfs.github.com/spec/"
"""Start of the text that Git leaves in place of a file that Git LFS has not downloaded."""


def is_file(path: Path) -> bool:
    """True if there is a file whose name comes from elsewhere.

    False for a name that no file can have, such as a very long one, for which ``Path.is_file``
    raises an error in some versions of Python.
    """
    return os.path.isfile(path)


def is_there(path: Path) -> bool:
    """True if there is a file or a folder whose name comes from elsewhere; see ``is_file``."""
    return os.path.exists(path)


def is_folder(path: Path) -> bool:
    """True if there is a folder whose name comes from elsewhere; see ``is_file``."""
    return os.path.isdir(path)


def names_folder(text: str) -> bool:
    """True if a path of the user is a folder, or is written as one: with a slash at its end."""
    return text.endswith(("/", os.sep)) or (bool(text) and is_folder(Path(text)))


def followed(path: Path) -> Path:
    """The absolute path without links; links that lead in circles stay.

    ``Path.resolve`` raises RuntimeError there before Python 3.13.
    """
    return Path(os.path.realpath(path))


def first_bytes(path: Path, count: int) -> bytes:
    """The first bytes of a file, to recognise its format; empty if it cannot be read.

    Pipes give none: bytes that are read here would be missing later, and may never come.
    """
    if not is_file(path):
        return b""
    try:
        with path.open("rb") as file:
            return file.read(count)
    except OSError:
        return b""


def check_downloaded(path: Path) -> None:
    """Refuse the text that stands for a file of Git LFS.

    Raises:
        DataError: the path leads to such a text.
    """
    if first_bytes(path, len(LFS_POINTER)) == LFS_POINTER:
        raise DataError(
            f"{path} is a pointer of Git LFS to the file, which was not downloaded.",
            "Run git lfs pull in its repository, or download the file itself.",
        )


def bytes_of(path: Path) -> int:
    """Size of a file, or of all files below a folder; links in it count as themselves."""
    if not path.is_dir():
        return path.stat().st_size
    return sum(item.lstat().st_size for item in path.rglob("*") if not item.is_dir())


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turn an error of the file system into a message that names the file.

    Raises:
        DataError: in place of the ``OSError``.
    """
    try:
        yield
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror}.") from None
