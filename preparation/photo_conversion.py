"""HEIC photos, an iPhone's usual ones, and AVIF photos become JPEG files, which all programs read.

``pi-heif`` decodes the first, Pillow from 11.3 on the second. Without them they are left out, with
advice.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePosixPath

import numpy as np
from PIL import Image, ImageOps, features

from gsfw.core.cores import cores
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.bounded_file import BoundedFile
from gsfw.core.files.reading import first_bytes
from gsfw.core.progress import stage
from gsfw.datamanagers.coded_colors import coded_to_srgb, is_like_srgb
from gsfw.datamanagers.color_profile import in_srgb, profile_of
from gsfw.datamanagers.images import EXTENSIONS, Header
from gsfw.preparation.foreign_formats import AVIF, BRANDS, HEAD, HEIC, ForeignFormat
from gsfw.preparation.image_set import LeftOut
from gsfw.preparation.input_files import InputFile, shot
from gsfw.preparation.journal import identity_of, short_key
from gsfw.preparation.video_frames import JPEG_QUALITY
from gsfw.preparation.writing.image_output import encoded, exif_of
from gsfw.preparation.writing.worker_threads import in_order, workers_for

DECODERS = {HEIC: "pi-heif", AVIF: "Pillow"}
"""Packages that decode the formats that are converted."""
COLOR_CODES = b"colrnclx"
"""Begins the box that states primaries and transfer of an AVIF image, two bytes each."""
SEARCHED = 65_536
"""Bytes of a file in which that box is looked for: those that tell of its images come first."""


@dataclass(frozen=True)
class Converted:
    """Input files after the conversion."""

    files: tuple[InputFile, ...]
    """All of them in order, converted ones in place of their originals."""
    damaged: tuple[LeftOut, ...] = ()
    """Files that do not decode."""
    notes: tuple[str, ...] = ()
    """Notes for the user; clauses without a period."""


def with_jpeg(files: Sequence[InputFile], folder: Path) -> Converted:
    """Convert HEIC and AVIF photos; those that were converted before are kept.

    They stay as they are without a decoder, and where the camera has written another format, too.

    Args:
        files: of any kind.
        folder: for the JPEG files.

    Raises:
        OutputError: one cannot be written.
    """
    found = {file: _format(file.path) for file in files}
    kinds = {file: kind for file, kind in found.items() if kind is not None}
    others = set(files).difference(kinds)
    shots = {shot(file.name) for file in others if file.path.suffix.lower() in EXTENSIONS}
    wanted = [
        file
        for file, kind in kinds.items()
        if (file.asked or shot(file.name) not in shots) and _is_installed(kind)
    ]
    if not wanted:
        return Converted(tuple(files))
    converted: dict[InputFile, InputFile] = {}
    damaged: dict[InputFile, LeftOut] = {}
    places = {file: _place(file, folder) for file in wanted}
    new = [file for file in wanted if not places[file].is_file()]
    unseen = set(new)
    results = in_order(partial(_content, kinds), new, _workers(new, kinds))
    with stage("converting photos", len(wanted)) as advance, closing(results):
        for number, file in enumerate(wanted, 1):
            content = next(results) if file in unseen else None
            if isinstance(content, LeftOut):
                damaged[file] = content
            else:
                if content is not None:
                    write_atomically(places[file], content)
                name = PurePosixPath(file.name).with_suffix(".jpg").as_posix()
                converted[file] = replace(file, path=places[file], name=name)
            advance(number)
    kept = (converted.get(file, file) for file in files if file not in damaged)
    counts = Counter(kinds[file].name for file in converted)
    notes = (
        f"{name} photos are converted to JPEG (quality {JPEG_QUALITY}): {count}"
        for name, count in counts.items()
    )
    return Converted(tuple(kept), tuple(damaged.values()), tuple(notes))


def _is_installed(kind: ForeignFormat) -> bool:
    """True if there is a decoder."""
    if kind is AVIF:
        return "avif" in features.modules and features.check_module("avif")
    try:
        import pi_heif  # noqa: F401
    except ImportError:  # Also where a library that it needs is missing.
        return False
    return True


def _format(path: Path) -> ForeignFormat | None:
    """HEIC or AVIF by the content of a file, as some phones name such files like a JPEG."""
    head = first_bytes(path, HEAD)
    kind = BRANDS.get(head[8:12]) if head[4:8] == b"ftyp" else None
    return kind if kind in DECODERS else None


def _place(file: InputFile, folder: Path) -> Path:
    """The JPEG file of a photo."""
    return folder / f"{short_key(identity_of(file.path))}.jpg"


def _workers(files: Sequence[InputFile], kinds: Mapping[InputFile, ForeignFormat]) -> int:
    """Number of photos to convert at a time; both decoders run without Python's lock."""
    headers = [_header(file.path, kinds[file]) for file in files]
    return workers_for(headers, cores()) if files else 1


def _header(path: Path, kind: ForeignFormat) -> Header:
    """The size of a photo; one pixel if it is damaged."""
    try:
        width, height = _heic_size(path) if kind is HEIC else _avif_size(path)
    except Exception:  # As in _content, which gives the reason.
        width = height = 1
    return Header(width, height, has_alpha=False)


def _heic_size(path: Path) -> tuple[int, int]:
    import pi_heif

    width, height = pi_heif.open_heif(path).size
    return width, height


def _avif_size(path: Path) -> tuple[int, int]:
    with BoundedFile(path) as file, Image.open(file, formats=(AVIF.name,)) as image:
        return image.size


def _content(kinds: Mapping[InputFile, ForeignFormat], file: InputFile) -> bytes | LeftOut:
    """The JPEG file of a photo, or why there is none."""
    kind = kinds[file]
    try:
        return _jpeg_of_heic(file.path) if kind is HEIC else _jpeg_of_avif(file.path)
    except MemoryError:
        raise
    except Exception as error:  # Decoders raise whatever a broken file makes them.
        if isinstance(error, OSError) and error.strerror:
            return LeftOut(file.name, f"the file cannot be read ({error.strerror})", "Replace it.")
        reason = (
            f"the {kind.name} image is damaged, or of a kind that {DECODERS[kind]} does not decode"
        )
        return LeftOut(file.name, reason, "Copy it again, or convert it to JPEG.")


def _jpeg_of_avif(path: Path) -> bytes:
    """The upright image in sRGB, with its EXIF data."""
    with path.open("rb") as stream:
        _, _, box = stream.read(SEARCHED).partition(COLOR_CODES)
    primaries, transfer = struct.unpack(">2H", box[:4]) if len(box) >= 4 else (0, 0)
    with BoundedFile(path) as file, Image.open(file, formats=(AVIF.name,)) as stored:
        image = ImageOps.exif_transpose(stored)
    if is_like_srgb(transfer, primaries) or image.info.get("icc_profile"):
        pixels = np.asarray(in_srgb(image, "RGB", profile_of(image)))
    else:
        deep = np.asarray(image.convert("RGB")).astype(np.uint16) * 257
        pixels = coded_to_srgb(deep, transfer, primaries)
    return encoded(pixels, "JPEG", JPEG_QUALITY, exif_of(image))


def _jpeg_of_heic(path: Path) -> bytes:
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
