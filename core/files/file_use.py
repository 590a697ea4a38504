"""File use: processes that share a folder wait for each other, and cut no file that one reads.

The system's locks decide, which end with their process. Windows and disks without locks have none:
there, each process goes on as if it were alone.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gsfw.core.files.atomic import WITHOUT_LOCKS

if sys.platform != "win32":
    import fcntl


@contextmanager
def in_turn(path: Path) -> Iterator[None]:
    """Wait until nobody else writes or reads the file at a path; until the end, nobody does.

    The file may be replaced inside. It is created if it is missing.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = _locked(path, os.O_RDWR | os.O_CREAT, is_shared=False)
    try:
        yield
    finally:
        _close(handle)


@contextmanager
def in_use(path: Path) -> Iterator[None]:
    """Mark the file at a path as one that is read; any number of blocks may do so at once."""
    try:
        handle = _locked(path, os.O_RDONLY, is_shared=True)
    except FileNotFoundError:
        handle = None
    try:
        yield
    finally:
        _close(handle)


@contextmanager
def if_unused(path: Path) -> Iterator[bool]:
    """Yield true if nobody writes or reads the file at a path; until the end, nobody does."""
    handle, is_unused = None, True
    try:
        handle = _locked(path, os.O_RDWR, is_shared=False, waits=False)
    except (BlockingIOError, FileNotFoundError):
        is_unused = False
    try:
        yield is_unused
    finally:
        _close(handle)


def _locked(path: Path, flags: int, is_shared: bool, waits: bool = True) -> int | None:
    """The open and locked file at a path; ``None`` where files have no locks.

    Raises:
        BlockingIOError: another has locked it, and this one is not to wait.
        FileNotFoundError: there is no such file.
    """
    if sys.platform == "win32":
        return None
    kind = fcntl.LOCK_SH if is_shared else fcntl.LOCK_EX
    while True:
        handle = os.open(path, flags, 0o644)
        try:
            fcntl.flock(handle, kind if waits else kind | fcntl.LOCK_NB)
            if _is_at(handle, path):
                return handle
        except OSError as error:
            os.close(handle)
            if error.errno in WITHOUT_LOCKS:
                return None
            raise
        # Another process has replaced the file while this one waited.
        os.close(handle)


def _is_at(handle: int, path: Path) -> bool:
    """True if the open file is the one at a path."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False


def _close(handle: int | None) -> None:
    if handle is not None:
        os.close(handle)
