"""NumPy's files (.npy, .npz), read in any thread.

What a header announces is compared with the bytes of the file before there is memory for it.
"""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedIOBase
from pathlib import Path
from threading import Lock
from typing import cast

import numpy as np
from jaxtyping import Float64, Shaped
from numpy.lib import format as numpy_format

from gsfw.core.errors import DataError
from gsfw.core.files.mirror import held

ARRAYS = (".npy", ".npz")
"""Extensions of NumPy's files."""
PARSING = Lock()
"""NumPy parses headers with ``ast.literal_eval``, which fails now and then where several threads
parse at a time (SystemError: AST constructor recursion depth mismatch; CPython 3.11)."""
NOT_READABLE = (OSError, ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""Errors of damaged archives; NotImplementedError is a RuntimeError."""
MOST_HEADER = 1 << 16
"""Bytes that are read for a header; NumPy parses none of more than 10,000."""
RATIO = 1032
"""Most bytes that Deflate makes of one: 258 of two bits (RFC 1951, 3.2.5)."""


@dataclass(frozen=True)
class ArrayHeader:
    """The type of an array."""

    shape: tuple[int, ...]
    dtype: np.dtype[np.generic]
    is_fortran: bool
    """True if the first axis varies fastest."""


def array_header(path: Path) -> ArrayHeader:
    """The type of the only array in a file, without its values.

    Raises:
        DataError: the file cannot be read, or holds several arrays.
    """
    with _opened(path) as (file, _):
        return _header(file)


def array_names(path: Path) -> tuple[str, ...]:
    """Names of the arrays of an archive, in its order.

    Raises:
        DataError: it is no archive.
    """
    try:
        with held(path, whole=True), zipfile.ZipFile(path) as archive:
            return tuple(name.removesuffix(".npy") for name in archive.namelist())
    except NOT_READABLE as error:
        raise DataError(f"{path} cannot be read: {error}", "Copy it again.") from error


def read_array(path: Path, name: str = "") -> Shaped[np.ndarray, ...]:
    """An array of a file.

    Args:
        path: of the file.
        name: of the array in an archive; empty for the only one.

    Raises:
        DataError: the file cannot be read, does not have the array, or holds Python objects.
    """
    with _opened(path, name) as (file, most):
        header = _header(file)
        if header.dtype.hasobject:
            raise ValueError("it holds Python objects, not numbers")
        count = math.prod(header.shape)
        if count * header.dtype.itemsize > most:
            raise EOFError("it is cut off, or its header is damaged")
        content = bytearray(count * header.dtype.itemsize)
        if file.readinto(content) != len(content):
            raise EOFError("it is cut off")
        values = np.frombuffer(content, header.dtype, count)
        return values.reshape(header.shape, order="F" if header.is_fortran else "C")


def read_numbers(path: Path, name: str = "") -> Float64[np.ndarray, ...]:
    """An array of real numbers; see ``read_array``.

    Raises:
        DataError: it cannot be read, or holds something else.
    """
    found = read_array(path, name)
    if found.dtype.kind not in "biuf":
        raise DataError(f"{path} holds values of type {found.dtype}.", "Expected real numbers.")
    with np.errstate(invalid="ignore", over="ignore"):  # A signalling NaN is a NaN, no warning.
        return found.astype(np.float64)


@contextmanager
def _opened(path: Path, name: str = "") -> Iterator[tuple[BufferedIOBase, int]]:
    """An array of a file, from its beginning, and the most bytes that it can have."""
    try:
        if path.suffix.lower() != ".npz":
            with held(path, whole=True), path.open("rb") as file:
                yield file, path.stat().st_size
            return
        with held(path, whole=True), zipfile.ZipFile(path) as archive:
            entry = _entry(path, archive, name)
            with archive.open(entry) as member:
                # typeshed says IO[bytes].
                yield cast(BufferedIOBase, member), min(entry.file_size, _most(entry))
    except DataError:
        raise
    except NOT_READABLE as error:
        raise DataError(f"{path} cannot be read: {error}", "Copy it again.") from error


def _entry(path: Path, archive: zipfile.ZipFile, name: str) -> zipfile.ZipInfo:
    entries = archive.infolist()
    if name:
        found = [entry for entry in entries if entry.filename == f"{name}.npy"]
        if not found:
            raise ValueError(f"it contains no array {name!r}")
        return found[0]
    if len(entries) != 1:
        names = ", ".join(entry.filename for entry in entries[:5])
        raise DataError(
            f"{path} holds {len(entries)} arrays ({names}).",
            "Expected one: save it with np.savez_compressed(path, values).",
        )
    return entries[0]


def _most(entry: zipfile.ZipInfo) -> int:
    """Most bytes that an entry of an archive unpacks to."""
    if entry.compress_type == zipfile.ZIP_STORED:
        return entry.compress_size
    if entry.compress_type == zipfile.ZIP_DEFLATED:
        return RATIO * entry.compress_size
    raise ValueError("it is packed in a way that NumPy does not write")


def _header(file: BufferedIOBase) -> ArrayHeader:
    try:
        with PARSING:
            head = io.BytesIO(file.read(MOST_HEADER))
            is_first = numpy_format.read_magic(head) == (1, 0)
            read = (
                numpy_format.read_array_header_1_0
                if is_first
                else numpy_format.read_array_header_2_0
            )
            shape, is_fortran, dtype = read(head)
            file.seek(head.tell())
    except OSError:
        raise
    except Exception as error:  # Python's tokenizer raises whatever a broken header makes it.
        raise ValueError(f"its header is damaged ({type(error).__name__})") from error
    if min(shape, default=0) < 0:
        raise ValueError(f"its shape is {shape}")
    return ArrayHeader(shape, dtype, is_fortran)
