"""The files of a SOG: in one ZIP archive, or beside one another in a folder."""

from __future__ import annotations

import zipfile
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gsfw.core.errors import COPY_AGAIN, DataError

META = "meta.json"
"""Name of the description."""
CHOOSE = f"Choose the .sog, or the {META} beside its images."
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Methods of compression that are read: LZMA would reserve as much memory as an entry asks for, up
to 4 GB."""
DAMAGED_ZIP = (
    zipfile.BadZipFile,
    zipfile.LargeZipFile,
    zlib.error,
    OSError,
    EOFError,
    ValueError,
    KeyError,
    IndexError,
    OverflowError,
    RuntimeError,
)
"""Errors of zipfile on damaged or encrypted archives; NotImplementedError is a RuntimeError."""


class Container(ABC):
    """The files of a SOG by name."""

    def __init__(self, path: Path, description: str) -> None:
        self.path = path
        self.description = description
        """Name of the description in it."""

    @abstractmethod
    def read(self, name: str, limit: int) -> bytes:
        """The content of a file, of at most ``limit`` bytes.

        Raises:
            DataError: there is none of this name, it is longer, or it is damaged.
        """

    @abstractmethod
    def size(self, name: str) -> int:
        """Bytes of a file in the container; 0 if there is none."""

    def missing(self, name: str) -> DataError:
        """The error for a file that is described and not there."""
        return DataError(f"{self.path}: there is no {name}, which belongs to it.", COPY_AGAIN)

    def too_long(self, name: str, limit: int) -> DataError:
        """The error for a file of more bytes than its content can take."""
        return DataError(f"{self.path}: its {name} is longer than {limit} bytes.", COPY_AGAIN)


class Folder(Container):
    """A folder with a description."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, path.name)

    def read(self, name: str, limit: int) -> bytes:
        """The content of a file beside the description."""
        try:
            with (self.path.parent / name).open("rb") as file:
                content = file.read(limit + 1)
        except FileNotFoundError:
            raise self.missing(name) from None
        except OSError as error:
            raise DataError(f"{self.path}: {name} cannot be read: {error.strerror}.") from None
        if len(content) > limit:
            raise self.too_long(name, limit)
        return content

    def size(self, name: str) -> int:
        """Bytes of a file beside the description."""
        try:
            return (self.path.parent / name).stat().st_size
        except OSError:
            return 0


class Archive(Container):
    """A ZIP archive."""

    def __init__(self, path: Path, archive: zipfile.ZipFile) -> None:
        super().__init__(path, META)
        self._archive = archive
        self._bytes = path.stat().st_size

    def read(self, name: str, limit: int) -> bytes:
        """The content of an entry; its check sum is verified."""
        try:
            entry = self._archive.getinfo(name)
        except KeyError:
            raise self.missing(name) from None
        if entry.file_size > limit:
            raise self.too_long(name, limit)
        if entry.compress_type not in METHODS:
            raise DataError(
                f"{self.path}: its {name} is neither stored nor deflated, but compressed by method "
                f"{entry.compress_type} of ZIP.",
                "Unpack it, and choose the meta.json beside its images.",
            )
        try:
            with self._archive.open(entry) as file:
                return file.read(limit + 1)
        except DAMAGED_ZIP as error:
            raise DataError(f"{self.path}: its {name} is damaged.", COPY_AGAIN) from error

    def size(self, name: str) -> int:
        """Bytes of an entry as it is stored."""
        try:
            return min(self._archive.getinfo(name).compress_size, self._bytes)
        except KeyError:
            return 0


@contextmanager
def opened(path: Path) -> Iterator[Container]:
    """The files of a ``.sog``, or those of a folder or beside its description.

    Raises:
        DataError: it cannot be read, or is a damaged archive.
    """
    try:
        path = path / META if path.is_dir() else path
        with path.open("rb") as file:
            start = file.read(2)
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror}.") from None
    except ValueError as error:  # A name that no file can have.
        raise DataError(f"{path} cannot be read: {error}.") from None
    if start[:1] == b"{":
        yield Folder(path)
        return
    if start != b"PK":
        raise DataError(f"{path} is no SOG: neither a ZIP archive nor a JSON.", CHOOSE)
    try:
        archive = zipfile.ZipFile(path)
    except DAMAGED_ZIP as error:
        raise DataError(f"{path} is a damaged ZIP archive.", COPY_AGAIN) from error
    with archive:
        yield Archive(path, archive)
