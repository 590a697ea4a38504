"""File copies: files with the same content under several names."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from gsfw.preparation.input_files import InputFile

CHUNK = 1 << 20
"""Bytes that are read at once."""


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
