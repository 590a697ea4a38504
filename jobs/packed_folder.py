"""PackedFolder: a folder as pieces of bytes, on its way from one machine to another."""

from __future__ import annotations

import shutil
import tarfile
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

PIECE = 64 * 1024 * 1024
"""Bytes of a piece: what has to be in memory at a time."""


def pack(folder: Path) -> Iterator[bytes]:
    """The pieces of a folder and all that is in it."""
    with tempfile.TemporaryFile() as file:
        # Not compressed: most of it are floats.
        with tarfile.open(fileobj=file, mode="w") as archive:
            archive.add(folder, arcname=".")
        file.seek(0)
        while piece := file.read(PIECE):
            yield piece


def unpack(pieces: Iterable[bytes], folder: Path) -> None:
    """Make a folder of its pieces; an earlier one is replaced once all of them are there.

    Raises:
        OSError: it cannot be written.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".arriving-") as place:
        with tempfile.TemporaryFile(dir=place) as file:
            for piece in pieces:
                file.write(piece)
            file.seek(0)
            with tarfile.open(fileobj=file) as archive:
                archive.extractall(Path(place) / "folder", filter="data")
        if folder.exists():
            shutil.rmtree(folder)
        (Path(place) / "folder").rename(folder)
