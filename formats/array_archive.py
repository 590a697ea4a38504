"""ArrayArchive: a JSON header and named arrays in one file that numpy.load reads directly.

A ZIP archive whose entries are not compressed: ``header.json``, or ``header.json.xz`` in small
files, then one ``.npy`` file of version 1.0 per array. Reading needs no more memory than the size
of the file, whatever its header states, and runs no code: pickled objects are refused.
"""

from __future__ import annotations

import json
import lzma
import math
import re
import struct
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gsfw.core.errors import COPY_AGAIN, DataError, UserError
from gsfw.core.files.atomic import atomic_file
from gsfw.core.files.json_text import parsed_json
from gsfw.core.files.ply_file import is_ply

HEADER, SHORT_HEADER = "header.json", "header.json.xz"
EXPANSION, SMALL = 64, 1 << 16
"""A short header has at most ``EXPANSION`` characters for each of its bytes, and ``SMALL`` ones."""
MOST_MEMORY = 1 << 26
"""Memory of XZ's decoder, in bytes; its usual settings need a seventh of it."""
SUFFIX = ".npy"
DTYPES = ("<f2", "<f4", "<f8", "|i1", "<i2", "<i4", "<i8", "|u1", "|b1")
"""Number types of the format: little-endian, in numpy's spelling."""
NAME = re.compile(r"[\w\-]+([./][\w\-]+)*", re.ASCII)
"""Names of arrays: words joined by dots and slashes, which never lead outside of a folder."""
NPY = re.compile(
    rb"\x93NUMPY\x01\x00(..)"
    rb"\{'descr': '([<|>][a-zA-Z]\d{0,2})', 'fortran_order': False, 'shape': \(([\d, ]*)\), \} *\n",
    re.DOTALL,
)
"""The beginning of an array as in numpy.save: the length of the header after ``PREFIX`` bytes, type
and shape. numpy's own parser would evaluate Python literals."""
PREFIX = 10
DATE = (1980, 1, 1, 0, 0, 0)
"""Date of every entry, so that equal content gives equal bytes."""
ENCRYPTED = 0x1

MALFORMED = (
    zipfile.BadZipFile,
    ValueError,
    KeyError,
    EOFError,
    struct.error,
    OverflowError,
    RuntimeError,
    NotImplementedError,
)
"""Errors of zipfile, numpy and json on malformed files."""


@dataclass(frozen=True)
class ArrayArchive:
    """Content of an archive."""

    header: Mapping[str, Any]
    """Plain data."""
    arrays: Mapping[str, np.ndarray]
    """Arrays by name, in the order of the file; read-only."""
    short: bool = False
    """True to write the header with XZ."""


def write_archive(path: Path, content: ArrayArchive) -> None:
    """Write the file atomically, array by array: no second copy of an array is made.

    Raises:
        OutputError: it cannot be written.
        ValueError: the format has no such type or name of an array.
    """
    with atomic_file(path) as target, zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as file:
        file.writestr(*_header(content))
        for name, array in content.arrays.items():
            if not NAME.fullmatch(name):
                raise ValueError(f"{name!r} cannot be the name of an array")
            if array.dtype.str not in DTYPES:
                raise ValueError(f"{name} is of type {array.dtype}")
            entry = _entry(name + SUFFIX)
            # The size decides before the first byte whether the entry is one of more than 4 GB.
            entry.file_size = array.nbytes + PREFIX
            with file.open(entry, "w") as stored:
                np.lib.format.write_array(stored, array, version=(1, 0), allow_pickle=False)


def _header(content: ArrayArchive) -> tuple[zipfile.ZipInfo, bytes]:
    """The entry of the header."""
    if not content.short:
        text = json.dumps(content.header, indent=1, allow_nan=False)
        return _entry(HEADER), text.encode()
    text = json.dumps(content.header, separators=(",", ":"), allow_nan=False)
    short = lzma.compress(text.encode())
    if len(text) > EXPANSION * len(short) + SMALL:
        return _entry(HEADER), text.encode()
    return _entry(SHORT_HEADER), short


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, DATE)
    entry.external_attr = 0o644 << 16
    return entry


def read_archive(path: Path, header_only: bool = False) -> ArrayArchive:
    """Read the file; with ``header_only`` without its arrays.

    Raises:
        DataError: it is missing, damaged, or no such archive; names the cause and the place.
    """
    try:
        with zipfile.ZipFile(path) as file:
            return _read(path, file, header_only)
    except UserError:
        raise
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}.") from None
    except MALFORMED as error:
        _check_is_no_ply(path)
        problem = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise DataError(f"{path} is damaged: {problem}.", COPY_AGAIN) from error


def array_bytes(path: Path) -> dict[str, int]:
    """Bytes of each array in a file, by name.

    Raises:
        DataError: it cannot be read.
    """
    try:
        with zipfile.ZipFile(path) as file:
            entries = file.infolist()
    except (OSError, *MALFORMED) as error:
        raise DataError(f"{path} cannot be read: {error}.", COPY_AGAIN) from error
    return {
        entry.filename.removesuffix(SUFFIX): entry.file_size
        for entry in entries
        if entry.filename.endswith(SUFFIX)
    }


def _check_is_no_ply(path: Path) -> None:
    """Refuse a splat file under another name as what it is.

    Raises:
        DataError: it begins as PLY files do.
    """
    if is_ply(path):
        raise DataError(
            f"{path} is a PLY file, despite its name.",
            f"Rename it to {path.with_suffix('.ply').name}.",
        )


def _read(path: Path, file: zipfile.ZipFile, header_only: bool) -> ArrayArchive:
    entries = file.infolist()
    _check_entries(entries, path.stat().st_size)
    names = {entry.filename for entry in entries}
    if not names & {HEADER, SHORT_HEADER}:
        raise DataError(
            f"{path} is no archive of arrays: it contains no {HEADER}.",
            "Give a file that gsfw export RUN format=gsfw has written.",
        )
    short = HEADER not in names
    header = parsed_json(_expanded(file.read(SHORT_HEADER)) if short else file.read(HEADER))
    if not isinstance(header, dict):
        raise ValueError(f"{HEADER} holds a {type(header).__name__}, not an object")
    arrays: dict[str, np.ndarray] = {}
    for entry in [] if header_only else entries:
        name = entry.filename.removesuffix(SUFFIX)
        if name != entry.filename:
            arrays[name] = _array(name, file.read(entry))
    return ArrayArchive(header, arrays, short)


def _expanded(short: bytes) -> bytes:
    """A header that was written with XZ, unless it is larger than any of its size should be."""
    decoder = lzma.LZMADecompressor(format=lzma.FORMAT_XZ, memlimit=MOST_MEMORY)
    try:
        text = decoder.decompress(short, max_length=EXPANSION * len(short) + SMALL)
    except lzma.LZMAError as error:
        raise ValueError(f"{SHORT_HEADER}: {error}") from error
    if not decoder.eof:
        raise ValueError(f"{SHORT_HEADER} is cut short, or far larger than its {len(short)} bytes")
    return text


def _check_entries(entries: list[zipfile.ZipInfo], size: int) -> None:
    """Refuse entries that would be larger than the file."""
    names = [entry.filename for entry in entries]
    if len(set(names)) < len(names):
        raise ValueError("two of its entries have the same name")
    for entry in entries:
        if entry.compress_type != zipfile.ZIP_STORED or entry.flag_bits & ENCRYPTED:
            raise ValueError(f"{entry.filename} is compressed or encrypted, which none should be")
    # Both sizes are read: zipfile makes room for the stored one.
    if sum(max(entry.file_size, entry.compress_size) for entry in entries) > size:
        raise ValueError("its entries announce more bytes than the file has")


def _array(name: str, stored: bytes) -> np.ndarray:
    """An array on the bytes of its ``.npy`` file, after a check of its shape against them."""
    start = NPY.match(stored)
    if start is None or int.from_bytes(start[1], "little") != start.end() - PREFIX:
        raise ValueError(f"{name} does not begin as a .npy file of version 1.0 in C order does")
    kind, shape = start[2].decode(), tuple(map(int, re.findall(rb"\d+", start[3])))
    if kind not in DTYPES:
        raise ValueError(f"{name} is of type {kind}, expected one of {', '.join(DTYPES)}")
    dtype = np.dtype(kind)
    expected, found = math.prod(shape) * dtype.itemsize, len(stored) - start.end()
    if expected != found:
        raise ValueError(f"{name} of shape {shape} should have {expected} bytes, found {found}")
    return np.frombuffer(stored, dtype, offset=start.end()).reshape(shape)
