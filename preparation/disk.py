"""Room on the disk, looked at before COLMAP writes: on a full one it aborts the whole process."""

from __future__ import annotations

import hashlib
import math
import shutil
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from gsfw.core.errors import OutputError
from gsfw.preparation.input_files import InputFile

ROOM = 32_000_000
"""Bytes that the database may grow by from one look to the next, with the log of its changes."""
CHUNK = 1 << 20
"""Bytes that are read at once."""


def check_room(path: Path, size: int = 0) -> None:
    """Check that a database can grow.

    Args:
        path: of its file, in a folder that exists.
        size: bytes that are written to it for certain.

    Raises:
        OutputError: the disk is nearly full, or the limit of the size of files is too low.
    """
    free = shutil.disk_usage(path.parent).free
    if free < ROOM + size:
        raise OutputError(
            f"the disk is nearly full: {path} may need {(ROOM + size) // 1_000_000} MB more, and "
            f"{free // 1_000_000} MB are free.",
            "Free some space, and the same command continues; or choose another folder: out=DIR.",
        )
    least = ROOM + size + (path.stat().st_size if path.is_file() else 0)
    if (limit := _size_limit()) < least:
        raise OutputError(
            f"files of this process may have at most {limit / 1e6:.1f} MB (ulimit -f), and {path} "
            f"may need {least // 1_000_000} MB.",
            "Raise the limit, and the same command continues.",
        )


def check_space(folder: Path, size: int, what: str) -> None:
    """Check that a disk has room for files.

    Args:
        folder: where they are written; it may not exist yet.
        size: bytes of all of them, at most.
        what: the files, in words.

    Raises:
        OutputError: it has not.
    """
    there = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    free = shutil.disk_usage(there).free
    if free < ROOM + size:
        raise OutputError(
            f"the disk is too full for {what}: they may need {(ROOM + size) // 1_000_000} MB, and "
            f"{free // 1_000_000} MB are free.",
            "Free some space, and the same command continues; or choose another folder: out=DIR.",
        )


def _size_limit() -> float:
    """Bytes that the system lets this process write to a file."""
    if sys.platform == "win32":
        return math.inf
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return math.inf if limit == resource.RLIM_INFINITY else float(limit)


def find_copies(files: Sequence[InputFile]) -> dict[InputFile, InputFile]:
    """Each file whose content has come before, and the first file that has it."""
    sizes = {file: file.path.stat().st_size for file in files}
    common = Counter(sizes.values())
    first: dict[tuple[int, bytes], InputFile] = {}
    copies = {}
    for file, size in sizes.items():
        if common[size] == 1:
            continue
        original = first.setdefault((size, _digest(file.path)), file)
        if original is not file:
            copies[file] = original
    return copies


def _digest(path: Path) -> bytes:
    digest = hashlib.blake2b()
    with path.open("rb") as stream:
        while chunk := stream.read(CHUNK):
            digest.update(chunk)
    return digest.digest()
