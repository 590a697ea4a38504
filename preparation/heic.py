"""HEIC photos, an iPhone's usual ones, become JPEG files, which all other programs read as well.

``pi-heif`` decodes them. Without it they are left out, with advice.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np
from PIL import Image

from gsfw.core.cores import cores
from gsfw.core.files.atomic import write_atomically
from gsfw.core.progress import stage
from gsfw.datamanagers.coded_colors import coded_to_srgb, is_like_srgb
from gsfw.datamanagers.color_profile import in_srgb, profile_of
from gsfw.datamanagers.images import EXTENSIONS, Header
from gsfw.preparation.foreign_formats import BRANDS, HEAD, HEIC
from gsfw.preparation.image_set import LeftOut
from gsfw.preparation.input_files import InputFile, shot
from gsfw.preparation.journal import identity_of
from gsfw.preparation.video_frames import JPEG_QUALITY
from gsfw.preparation.writing.image_output import encoded, exif_of
from gsfw.preparation.writing.worker_threads import in_order, workers_for

DAMAGED = "the HEIC image is damaged, or of a kind that pi-heif does not decode"
"""Reason why a file is left out."""


@dataclass(frozen=True)
class Converted:
    """Input files after the conversion."""

    files: tuple[InputFile, ...]
    """All of them in order, converted ones in place of their HEIC files."""
    damaged: tuple[LeftOut, ...] = ()
    """HEIC files that do not decode."""
    notes: tuple[str, ...] = ()
    """Notes for the user; clauses without a period."""


def with_jpeg(files: Sequence[InputFile], folder: Path) -> Converted:
    """Convert HEIC photos; those that were converted before are kept.

    They stay as they are without ``pi-heif``, and where the camera has written another format, too.

    Args:
        files: of any kind.
        folder: for the JPEG files.

    Raises:
        OutputError: one cannot be written.
    """
    heic = [file for file in files if _is_heic(file.path)]
    others = set(files).difference(heic)
    shots = {shot(file.name) for file in others if file.path.suffix.lower() in EXTENSIONS}
    wanted = [file for file in heic if file.asked or shot(file.name) not in shots]
    if not wanted or not _is_installed():
        return Converted(tuple(files))
    converted: dict[InputFile, InputFile] = {}
    damaged: dict[InputFile, LeftOut] = {}
    places = {file: _place(file, folder) for file in wanted}
    new = [file for file in wanted if not places[file].is_file()]
    unseen = set(new)
    results = in_order(_content, new, _workers(new))
    with stage("converting HEIC photos", len(wanted)) as advance, closing(results):
        for number, file in enumerate(wanted, 1):
            found = next(results) if file in unseen else None
            if isinstance(found, LeftOut):
                damaged[file] = found
            else:
                if found is not None:
                    write_atomically(places[file], found)
                name = PurePosixPath(file.name).with_suffix(".jpg").as_posix()
                converted[file] = replace(file, path=places[file], name=name)
            advance(number)
    kept = (converted.get(file, file) for file in files if file not in damaged)
    note = f"HEIC photos are converted to JPEG (quality {JPEG_QUALITY}): {len(converted)}"
    return Converted(tuple(kept), tuple(damaged.values()), (note,) if converted else ())


def _is_installed() -> bool:
    try:
        import pi_heif  # noqa: F401
    except ImportError:  # Also where a library that it needs is missing.
        return False
    return True


def _is_heic(path: Path) -> bool:
    """True if the content of a file is HEIC: some phones name such files like a JPEG."""
    try:
        with path.open("rb") as stream:
            head = stream.read(HEAD)
    except OSError:  # Whoever examines the file says so.
        return False
    return head[4:8] == b"ftyp" and BRANDS.get(head[8:12]) is HEIC


def _place(file: InputFile, folder: Path) -> Path:
    """The JPEG file of a photo."""
    key = hashlib.blake2b(repr(identity_of(file.path)).encode(), digest_size=12).hexdigest()
    return folder / f"{key}.jpg"


def _workers(files: Sequence[InputFile]) -> int:
    """Number of photos to convert at a time; pi-heif decodes without Python's lock."""
    return workers_for([_header(file.path) for file in files], cores()) if files else 1


def _header(path: Path) -> Header:
    """The size of a photo; one pixel if it is damaged."""
    import pi_heif

    try:
        width, height = pi_heif.open_heif(path).size
    except Exception:  # As in _content, which gives the reason.
        width = height = 1
    return Header(width, height, has_alpha=False)


def _content(file: InputFile) -> bytes | LeftOut:
    """The JPEG file of a photo, or why there is none."""
    try:
        return _jpeg(file.path)
    except MemoryError:
        raise
    except Exception as error:  # pi-heif raises whatever a broken file makes it.
        if isinstance(error, OSError) and error.strerror:
            return LeftOut(file.name, f"the file cannot be read ({error.strerror})", "Replace it.")
        return LeftOut(file.name, DAMAGED, "Copy it again, or convert it to JPEG.")


def _jpeg(path: Path) -> bytes:
    """The upright image in sRGB, with its EXIF data."""
    import pi_heif

    stored = pi_heif.open_heif(path)
    color = stored.info.get("nclx_profile", {})
    codes = color.get("transfer_characteristics", 0), color.get("color_primaries", 0)
    if is_like_srgb(*codes) or stored.info.get("icc_profile"):
        image = stored.to_pillow()
        pixels = np.asarray(in_srgb(image, "RGB", profile_of(image)))
        return encoded(pixels, "JPEG", JPEG_QUALITY, exif_of(image))
    stored = pi_heif.open_heif(path, convert_hdr_to_8bit=False)
    numbers = np.array(stored)[..., :3]
    deep = numbers if numbers.dtype == np.uint16 else numbers.astype(np.uint16) * 257
    image = Image.fromarray(coded_to_srgb(deep, *codes))
    image.info["exif"] = stored.info.get("exif") or b""
    return encoded(np.asarray(image), "JPEG", JPEG_QUALITY, exif_of(image))
