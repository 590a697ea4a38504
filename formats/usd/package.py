"""Packages: usd-core, which reads and writes stages; and .usdz, a ZIP archive of stages."""

from __future__ import annotations

import errno
import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from gsfw.core.errors import COPY_AGAIN, DataError, UnavailableError
from gsfw.core.files.atomic import disk_error
from gsfw.core.files.reading import first_bytes
from gsfw.formats.sog.container import DAMAGED_ZIP

SUFFIX, PACKAGE = ".usdc", ".usdz"
"""Suffixes of a stage in bytes, and of a package with all that a stage needs."""
STAGES = (SUFFIX, ".usda", ".usd")
"""Suffixes of stages."""
ZIP = b"PK\x03\x04"
ON_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of the system that OpenUSD reports as text."""


def check_available() -> None:
    """Check that usd-core is there, with the schema of splats.

    Raises:
        UnavailableError: it is missing, or older than the schema.
    """
    try:
        from pxr import UsdVol

        UsdVol.ParticleField3DGaussianSplat  # noqa: B018
    except (ImportError, AttributeError):
        raise UnavailableError(
            "files of USD need OpenUSD 26.03 or later, and its package usd-core is not installed.",
            "Install it with: pip install 'gsfw[usd]' (or: pip install 'usd-core>=26.3').",
        ) from None


@contextmanager
def system_errors() -> Iterator[None]:
    """Raise the errors of the system that OpenUSD reports as text.

    Raises:
        OSError: such as a full disk.
    """
    from pxr import Tf

    try:
        yield
    except Tf.ErrorException as error:
        for number in ON_DISK:
            if os.strerror(number) in str(error):
                raise OSError(number, os.strerror(number)) from error
        raise


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """The stage of a file: the file itself, or the first one of a package, in a temporary folder.

    OpenUSD does not end on some damaged packages; Python's ``zipfile`` does.

    Raises:
        DataError: the package is damaged, or has no stage.
        OutputError: the disk of temporary files is full or fails.
    """
    if first_bytes(path, len(ZIP)) != ZIP:
        yield path
        return
    with TemporaryDirectory(prefix="gsfw-usdz-") as folder:
        try:
            with zipfile.ZipFile(path) as archive:
                stages = [item for item in archive.infolist() if _is_stage(item)]
                size = sum(item.file_size for item in stages)
                # Entries of packages are stored, not compressed, and none uses the bytes of others.
                if size > path.stat().st_size or any(item.compress_type for item in stages):
                    raise zipfile.BadZipFile
                found = [_written(archive, item, Path(folder).resolve()) for item in stages]
        except DAMAGED_ZIP as error:
            damage = DataError(f"{path} is a damaged package of USD.", COPY_AGAIN)
            raise disk_error(error, Path(folder)) or damage from None
        if not found:
            raise DataError(
                f"{path} contains no splats: there is no stage of USD in the package.",
                "Export it as splats with OpenUSD 26.03 or later from the tool that made it.",
            )
        yield found[0]


def _written(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, folder: Path) -> Path:
    """The place below a folder that an entry is written to.

    Raises:
        BadZipFile: its name leads out of the folder.
    """
    place = (folder / entry.filename).resolve()
    if not place.is_relative_to(folder):
        raise zipfile.BadZipFile
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(archive.read(entry))
    return place


def _is_stage(entry: zipfile.ZipInfo) -> bool:
    return entry.filename.lower().endswith(STAGES)
