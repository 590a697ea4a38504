"""Unread splats: formats of splats that are recognised by content, and cannot be read yet.

SOG (PlayCanvas): https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog/.
SPZ (Niantic): https://github.com/nianticlabs/spz; up to version 3 all of it is compressed by gzip.
"""

from __future__ import annotations

import gzip
import json
import shlex
import zipfile
import zlib
from pathlib import Path

from gsfw.core.errors import DataError

META = "meta.json"
"""Description of a SOG, beside its images or in one ZIP file with them."""
SOG_KEYS = ("means", "scales", "quats", "sh0")
"""Entries that every SOG describes, each with the names of its images."""
SPZ_MAGIC, GZIP_MAGIC = b"NGSP", b"\x1f\x8b"
CONVERTER = "npx @playcanvas/splat-transform"
"""A free tool that reads both and writes PLY."""


def refuse_unread_splats(path: Path) -> None:
    """Refuse splats of a known format that cannot be read; anything else passes.

    Raises:
        DataError: these are such splats; says which, and how to convert them.
    """
    try:
        found = _recognised(path)
    except (OSError, ValueError, EOFError, zlib.error, zipfile.BadZipFile):
        return
    if found is None:
        return
    name, source = found
    command = f"{CONVERTER} {shlex.quote(str(source))} splats.ply"
    raise DataError(
        f"{path}: these are splats in the format {name}, which gsfw cannot read yet.",
        f"Convert them to PLY first: {command}",
    )


def _recognised(path: Path) -> tuple[str, Path] | None:
    """Name of the format, and the file to convert; ``None`` for anything else."""
    description = path / META if path.is_dir() else path
    if description.name == META and description.is_file():
        is_sog = _describes_sog(description.read_bytes())
        return ("SOG", description) if is_sog else None
    if not path.is_file():
        return None
    with path.open("rb") as file:
        start = file.read(4)
    if start[:2] == GZIP_MAGIC:
        with gzip.open(path) as unpacked:
            start = unpacked.read(4)
    if start == SPZ_MAGIC:
        return "SPZ", path
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            if META in archive.namelist() and _describes_sog(archive.read(META)):
                return "SOG", path
    return None


def _describes_sog(content: bytes) -> bool:
    document = json.loads(content)
    return isinstance(document, dict) and all(
        isinstance(document.get(key), dict) and "files" in document[key] for key in SOG_KEYS
    )
