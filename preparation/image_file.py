"""ImageFile: a file that is found to hold an image, whatever its name says, or why it does not.

Only its beginning is looked at; whether all of it decodes is known when features are computed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import PurePosixPath

from PIL import Image

from gsfw.core.errors import DataError
from gsfw.core.files.bounded_file import BoundedFile
from gsfw.datamanagers.frames import name_key
from gsfw.datamanagers.images import EXTENSIONS, FORMATS, Header, read_header
from gsfw.preparation.foreign_formats import (
    BY_EXTENSION,
    HEAD,
    RAW_EXTENSIONS,
    TWO_FISHEYE_EXTENSIONS,
    foreign_format,
)
from gsfw.preparation.image_set import LeftOut
from gsfw.preparation.input_files import InputFile

KNOWN = f"{', '.join(FORMATS[:-1])} or {FORMATS[-1]}"

MAGIC = (b"\xff\xd8\xff", b"\x89PNG\r\n", b"RIFF", b"II*\0", b"MM\0*")
"""First bytes of these formats; BMP's two letters are too few to recognise it."""
SUFFIXES = {
    "JPEG": (".jpg", ".jpeg"),
    "MPO": (".jpg", ".jpeg"),
    "PNG": (".png",),
    "WEBP": (".webp",),
    "TIFF": (".tif", ".tiff"),
    "BMP": (".bmp",),
}
"""Extensions of Pillow's formats, the usual one first. MPO is JPEG with further images behind."""


@dataclass(frozen=True)
class ImageFile:
    """A file whose beginning is that of an image."""

    file: InputFile
    header: Header
    content: str
    """Its format, as Pillow calls it."""
    pages: int = 1
    """Number of images in the file; the first is used."""


def examine(file: InputFile) -> ImageFile | LeftOut | None:
    """Look at a file that is no video; ``None`` for one that does not claim to be an image."""
    suffix = file.path.suffix.lower()
    claims = file.asked or suffix in EXTENSIONS
    try:
        with file.path.open("rb") as stream:
            head = stream.read(HEAD)
    except OSError as error:
        return LeftOut(file.name, f"the file cannot be read ({error.strerror})", "Replace it.")
    if suffix in (*RAW_EXTENSIONS, *TWO_FISHEYE_EXTENSIONS):
        # RAW files are TIFF files to Pillow, with a thumbnail as the image.
        kind = BY_EXTENSION[suffix]
        return LeftOut(file.name, kind.reason, kind.advice)
    if not head:
        return empty(file) if claims else None
    return _examined(file, head, claims)


def _examined(file: InputFile, head: bytes, claims: bool) -> ImageFile | LeftOut | None:
    """A file that is neither empty nor of a format that is known by its extension."""
    try:
        header = read_header(file.path)
        content, pages = _content(file)
    except DataError as error:
        foreign = foreign_format(file.path.suffix.lower(), head)
        if foreign is not None:
            return LeftOut(file.name, foreign.reason, foreign.advice)
        return LeftOut(file.name, *_why(file, head, error)) if claims else None
    return ImageFile(file, header, content, pages)


def empty(file: InputFile) -> LeftOut:
    """The entry for a file without content."""
    return LeftOut(file.name, "the file is empty (0 bytes)", "Copy it again from the camera.")


def _why(file: InputFile, head: bytes, error: DataError) -> tuple[str, str]:
    """A reason and advice."""
    if isinstance(error.__cause__, Image.DecompressionBombError):
        return "it has too many pixels to be decoded safely", "Shrink all images by one factor."
    if error.__cause__ is None:
        return error.message.removeprefix(f"{file.path}: ").rstrip("."), error.advice
    if head.startswith(MAGIC):
        return "the image is cut off or damaged: its header is not whole", "Copy it again."
    return f"it is no {KNOWN} image, by its content", "Replace or remove it."


def _content(file: InputFile) -> tuple[str, int]:
    """The format and the number of images."""
    with BoundedFile(file.path) as data, Image.open(data, formats=FORMATS) as image:
        content = str(image.format)
        if content == "MPO":
            # Phones append a preview or a depth map to a JPEG, not another photo.
            return content, 1
        try:
            return content, int(getattr(image, "n_frames", 1))
        except Exception:  # Pillow raises whatever a broken file makes it; the first one is there.
            return content, 1


def has_right_suffix(name: str, content: str) -> bool:
    """True if a name says what format its file has."""
    return PurePosixPath(name).suffix.lower() in SUFFIXES[content]


def with_right_suffix(name: str, content: str) -> str:
    """The name with the suffix of its file's format; other programs go by it.

    What is no suffix stays: "2024.05.01" becomes "2024.05.01.jpg".
    """
    if has_right_suffix(name, content):
        return name
    path = PurePosixPath(name)
    stem = path.stem if path.suffix[1:].isalpha() and len(path.suffix) <= 5 else path.name
    return path.with_name(stem + SUFFIXES[content][0]).as_posix()


def unique_names(names: Iterable[str]) -> list[str]:
    """The names, with "_2" and so on before the suffix of those that some disk takes for equal."""
    taken: set[str] = set()
    unique = []
    for name in names:
        path, choice, number = PurePosixPath(name), name, 1
        while name_key(choice) in taken:
            number += 1
            choice = path.with_name(f"{path.stem}_{number}{path.suffix}").as_posix()
        taken.add(name_key(choice))
        unique.append(choice)
    return unique
