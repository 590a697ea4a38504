"""Buffers: the bytes that the values of a glTF document lie in, in the file and beside it."""

from __future__ import annotations

import base64
import binascii
from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.files.json_fields import JsonFields

DATA = "data:"
ENCODED = ";base64,"


class Buffers:
    """The buffers of a document; each is read when it is asked for, each file once."""

    def __init__(self, stated: list[JsonFields], binary: bytes) -> None:
        """Take the list of a document, and the binary chunk of a .glb, which is the first one."""
        self.stated = stated
        self._binary = binary
        self._read: dict[int, memoryview] = {}
        self._files: dict[Path, bytes] = {}

    def size(self) -> int:
        """Bytes that are there; a file that several buffers name counts once, and is not read.

        Raises:
            DataError: a file is missing, or not in the folder of the document.
        """
        uris = [buffer.text("uri") for buffer in self.stated if "uri" in buffer]
        # Four characters of base64 are three bytes.
        inside = sum(len(uri.partition(ENCODED)[2]) for uri in uris if uri.startswith(DATA))
        path = self.stated[0].path if self.stated else Path()
        places = {_place(path, unquote(uri)) for uri in uris if not uri.startswith(DATA)}
        sizes = [_size(path, place) for place in places]
        return len(self._binary) + inside * 3 // 4 + sum(sizes)

    def beside(self) -> int:
        """Bytes of the files beside the document that are there; each counts once."""
        sizes: dict[Path, int] = {}
        for buffer in self.stated:
            with suppress(DataError):
                uri = buffer.text("uri", default=DATA)
                if uri.startswith(DATA):
                    continue
                place = _place(buffer.path, unquote(uri))
                size = _size(buffer.path, place)
                if place.is_file() and place != buffer.path.resolve():
                    sizes[place] = size
        return sum(sizes.values())

    def content(self, index: int) -> memoryview:
        """The bytes of a buffer.

        Raises:
            DataError: it is damaged, elsewhere, or shorter than stated.
        """
        if index not in self._read:
            buffer = self.stated[index]
            own = self._binary if index == 0 else b""
            self._read[index] = self._linked(buffer) if "uri" in buffer else memoryview(own)
        return self._read[index]

    def _linked(self, buffer: JsonFields) -> memoryview:
        """A buffer in the JSON itself, or in a file of the same folder."""
        uri, length, path = buffer.text("uri"), buffer.count("byteLength"), buffer.path
        if uri.startswith(DATA):
            try:
                content = base64.b64decode(uri.partition(ENCODED)[2], validate=True)
            except (binascii.Error, ValueError):
                raise buffer.refuse("uri", "base64 data") from None
        else:
            content = self._file(path, unquote(uri))
        if len(content) < length:
            raise DataError(
                f"{path}: {buffer.where} has {length} bytes, and {len(content)} are there.",
                COPY_AGAIN,
            )
        return memoryview(content)

    def _file(self, path: Path, name: str) -> bytes:
        place = _place(path, name)
        if place not in self._files:
            try:
                self._files[place] = place.read_bytes()
            except OSError as error:
                raise _unreadable(path, name, error) from None
        return self._files[place]


def _place(path: Path, name: str) -> Path:
    """A file in the folder of another one, or below."""
    folder = path.resolve().parent
    try:
        place = (folder / name).resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise _unreadable(path, name, error) from None
    if not place.is_relative_to(folder) or ":" in name or "\\" in name:
        raise DataError(
            f"{path}: its buffer {name[:60]!r} is not in the folder of the file.",
            "Put both files into one folder, or export a .glb.",
        )
    return place


def _size(path: Path, place: Path) -> int:
    try:
        return place.stat().st_size
    except OSError as error:
        raise _unreadable(path, place.name, error) from None


def _unreadable(path: Path, name: str, error: Exception) -> DataError:
    reason = getattr(error, "strerror", None) or error
    return DataError(f"{path}: its buffer {name[:60]!r} cannot be read: {reason}.")
