"""Bounded file: reads that take no more memory than the file has bytes."""

from __future__ import annotations

import io
from pathlib import Path


class BoundedFile(io.BufferedReader):
    """A file to read, for decoders that ask for as many bytes as a chunk of it announces.

    Python takes memory for all bytes that it is asked for, before it looks how many there are.
    """

    def __init__(self, path: Path) -> None:
        """Open a file.

        Raises:
            OSError: it cannot be opened.
        """
        super().__init__(io.FileIO(path))
        self._size = path.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """Read at most ``size`` bytes; all that are left without a size."""
        return super().read(-1 if size is None else min(size, self._size))
