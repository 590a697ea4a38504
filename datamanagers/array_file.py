"""NumPy's files (.npy, .npz), read in any thread."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedIOBase
from pathlib import Path
from threading import Lock
from typing import cast

import numpy as np
from jaxtyping import Shaped
from numpy.lib import format as numpy_format

from gsfw.core.errors import DataError
from gsfw.core.files.mirror import held

ARRAYS = (".npy", ".npz")
"""Extensions of NumPy's files."""
PARSING = Lock()
"""NumPy parses headers with ``ast.literal_eval``, which fails now and then where several threads
parse at a time (SystemError: AST constructor recursion depth mismatch; CPython 3.11)."""


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
    with _opened(path) as file:
        return _header(file)


def read_array(path: Path) -> Shaped[np.ndarray, ...]:
    """The only array in a file.

    Raises:
        DataError: the file cannot be read, or holds several arrays, or Python objects.
    """
    with _opened(path) as file:
        header = _header(file)
        if header.dtype.hasobject:
            raise ValueError("it holds Python objects, not numbers")
        count = int(np.prod(header.shape, dtype=np.int64))
        content = bytearray(count * header.dtype.itemsize)
        if file.readinto(content) != len(content):
            raise EOFError("it is cut off")
        values = np.frombuffer(content, header.dtype, count)
        return values.reshape(header.shape, order="F" if header.is_fortran else "C")


@contextmanager
def _opened(path: Path) -> Iterator[BufferedIOBase]:
    """The array in a file, from its beginning."""
    try:
        if path.suffix.lower() != ".npz":
            with held(path, whole=True), path.open("rb") as file:
                yield file
            return
        with held(path, whole=True), zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            if len(names) != 1:
                raise DataError(
                    f"{path} holds {len(names)} arrays ({', '.join(names[:5])}).",
                    "Expected one: save it with np.savez_compressed(path, values).",
                )
            with archive.open(names[0]) as member:
                yield cast(BufferedIOBase, member)  # typeshed says IO[bytes].
    except DataError:
        raise
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise DataError(f"{path} cannot be read: {error}", "Copy it again.") from error


def _header(file: BufferedIOBase) -> ArrayHeader:
    with PARSING:
        is_first = numpy_format.read_magic(file) == (1, 0)
        read = (
            numpy_format.read_array_header_1_0 if is_first else numpy_format.read_array_header_2_0
        )
        shape, is_fortran, dtype = read(file)
    return ArrayHeader(shape, dtype, is_fortran)
