"""Folder lock: keeps a folder to one program at a time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from gsfw.core.errors import OutputError
from gsfw.core.files.atomic import readable_write_errors

fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # Windows: nothing keeps two programs from one folder there.
    fcntl = None

LOCK = ".lock"
"""The file that is locked; it stays, and tells whose folder it is in."""


@contextmanager
def only_one(folder: Path, others: str) -> Iterator[int | None]:
    """Keep others from a folder; yields the open lock for processes to inherit.

    A process that inherits the lock and outlives its parent still holds it.

    Args:
        folder: made where it is not there.
        others: whom to keep out, for messages, such as "another study".

    Raises:
        OutputError: one of them works there, or the folder cannot be written to or locked.
    """
    with readable_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        if fcntl is not None:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise OutputError(
                    f"{folder}: {others} is at work there.",
                    "Wait for it, end it, or choose another folder with out=DIR.",
                ) from None
            except OSError as error:
                raise OutputError(
                    f"{folder} cannot be locked against {others}: {error.strerror}.",
                    "Choose a folder on another disk with out=DIR.",
                ) from None
        yield handle
    finally:
        os.close(handle)
