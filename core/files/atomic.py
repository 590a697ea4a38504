"""Atomic writes: a file has its old or its new content at every moment."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from shutil import rmtree
from typing import BinaryIO

from gsfw.core.errors import OutputError

NOT_WRITABLE = (
    errno.EACCES,
    errno.EPERM,
    errno.EROFS,
    errno.ENOTDIR,
    errno.ENOENT,
    errno.EEXIST,
    errno.ENAMETOOLONG,
    errno.EISDIR,
    errno.ELOOP,
)
"""System errors of an unusable place.

EEXIST: a file is in the place of a folder. EISDIR: a folder is in that of a file. ELOOP: links lead
to each other.
"""


PLACE = "another place with out=DIR"
"""Remedy of most verbs for a place that cannot be written to."""


@contextmanager
def other_place(remedy: str) -> Iterator[None]:
    """Let the advice of write errors name the argument that chooses the place.

    Args:
        remedy: what else to choose, such as "another place for OUT".

    Raises:
        OutputError: in place of the one inside the block.
    """
    try:
        yield
    except OutputError as error:
        raise OutputError(error.message, error.advice.replace(PLACE, remedy)) from error


@contextmanager
def readable_write_errors(path: Path) -> Iterator[None]:
    """Turn the system's write errors into one clear message.

    Raises:
        OutputError: the disk is full, or the place is not writable.
    """
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise OutputError(
                f"the disk is full: {path} could not be written.",
                f"Free some space, or choose {PLACE}.",
            ) from error
        if error.errno in NOT_WRITABLE:
            raise OutputError(
                f"{path} cannot be written: {os.strerror(error.errno or 0)}.",
                f"Choose {PLACE}.",
            ) from error
        raise


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file for writing so that at every moment the old or the complete new one exists.

    The file may be written part by part, and positions in it may be revisited (``seek``). An error
    inside the block leaves the old file, if any, untouched, and no new folder.

    Raises:
        OutputError: it cannot be written.
    """
    with readable_write_errors(path), without_new_folders(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            os.chmod(name, 0o666 & ~_umask())
            os.replace(name, path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise


@contextmanager
def without_new_folders(folder: Path) -> Iterator[None]:
    """After an error, remove a folder and its parents as far as they are new and empty."""
    new = [item for item in (folder, *folder.parents) if not item.exists()]
    try:
        yield
    except BaseException:
        with suppress(OSError):
            for item in new:
                item.rmdir()
        raise


@contextmanager
def folder_or_nothing(folder: Path) -> Iterator[None]:
    """After an error, remove a folder with all of its files, unless it was there before.

    Raises:
        OutputError: in place of an ``OSError``.
    """
    with readable_write_errors(folder), without_new_folders(folder.parent):
        is_new = not folder.exists()
        try:
            yield
        except BaseException:
            if is_new:
                rmtree(folder, ignore_errors=True)
            raise


def write_atomically(path: Path, content: bytes) -> None:
    """Write a whole file, as ``atomic_file`` does.

    Raises:
        OutputError: it cannot be written; the old file, if any, is untouched.
    """
    with atomic_file(path) as file:
        file.write(content)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
