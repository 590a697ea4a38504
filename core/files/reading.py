"""Reading: errors of the file system as messages for the user."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gsfw.core.errors import DataError


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
