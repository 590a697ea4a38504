"""Folder lock: restricts a folder to one program at a time."""

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
except ImportError:  # Windows: nothing restricts a folder to one program there.
    fcntl = None

LOCK = ".lock"
"""Name of the locked file; it is kept, and marks the folder as gsfw's."""


@contextmanager
def only_one(folder: Path, others: str) -> Iterator[int | None]:
    """Lock a folder; yields the open lock for child processes.

    A process that inherits the lock and outlives its parent still holds it.

    Args:
        folder: created if it is missing.
        others: description of the excluded programs for messages, such as "another study".

    Raises:
        OutputError: another program has the lock, or the folder cannot be written to or locked.
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
