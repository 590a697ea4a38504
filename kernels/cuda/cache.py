"""KernelCache: compiled kernels on disk, so that each is compiled once per machine."""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Iterable
from pathlib import Path
from typing import ClassVar

from gsfw.core.errors import OutputError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.user_folder import cache_root

logger = logging.getLogger(__name__)

FOLDER = "GSFW_CACHE_DIR"
"""Environment variable: the folder for what gsfw can make again."""


def cache_folder() -> Path:
    """Folder of compiled kernels: ``GSFW_CACHE_DIR``, or one among the system's caches.

    What is in it may be deleted at any time.
    """
    if os.environ.get(FOLDER):
        return Path(os.environ[FOLDER], "kernels").expanduser()
    # Without a home nothing can be kept, and writing says so.
    return (cache_root() or Path(os.devnull, "gsfw")) / "kernels"


def cache_key(parts: Iterable[str]) -> str:
    """A name for what is made of these texts; any other texts, or another order, give another."""
    digest = hashlib.sha256()
    for part in parts:
        encoded = part.encode()
        digest.update(b"%d\n" % len(encoded) + encoded)
    return digest.hexdigest()


class KernelCache:
    """A folder of compiled kernels, which several processes may use at once.

    An entry is one file: a checksum, the kernel's name, its code. What cannot be read counts as
    absent; what cannot be written is left unwritten, with one warning per process.
    """

    _warned: ClassVar[bool] = False

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def read(self, key: str) -> tuple[str, bytes] | None:
        """Name and code of a kernel; ``None`` when they are absent or damaged."""
        try:
            content = self._path(key).read_bytes()
        except OSError:
            return None
        checksum, _, rest = content.partition(b"\n")
        if checksum != _checksum(rest):
            return None
        name, _, code = rest.partition(b"\n")
        return name.decode(), code

    def write(self, key: str, name: str, code: bytes) -> None:
        """Keep a kernel, if the folder can be written to."""
        rest = name.encode() + b"\n" + code
        try:
            write_atomically(self._path(key), _checksum(rest) + b"\n" + rest)
        except (OutputError, OSError) as error:
            if not KernelCache._warned:
                KernelCache._warned = True
                logger.warning(
                    "CUDA kernels will be compiled again by the next process: %s "
                    "Set %s to a folder that can be written to.",
                    error.message if isinstance(error, OutputError) else error,
                    FOLDER,
                )

    def problem(self) -> str:
        """The reason why nothing can be written to the folder; empty if none is known."""
        existing = self.folder
        while not existing.exists() and existing != existing.parent:
            existing = existing.parent
        if existing.is_dir() and os.access(existing, os.W_OK | os.X_OK):
            return ""
        return f"{existing} cannot be written to; set {FOLDER}"

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.kernel"


def _checksum(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()
