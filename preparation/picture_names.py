"""Picture names: those of the result, that hold on every disk and say what is in the files."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from pathlib import PurePosixPath

SUFFIXES = {
    "JPEG": (".jpg", ".jpeg"),
    "MPO": (".jpg", ".jpeg"),
    "PNG": (".png",),
    "WEBP": (".webp",),
    "TIFF": (".tif", ".tiff"),
    "BMP": (".bmp",),
}
"""Of what Pillow calls formats, the usual one first. MPO is JPEG with further pictures behind."""


def has_right_suffix(name: str, content: str) -> bool:
    """Whether a name says what format its file has."""
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
    """The names, with "_2" and so on before the suffix of those that some disk takes for equal.

    Disks of Windows and macOS take A.JPG for a.jpg; that of macOS also é for e with an accent.
    """
    taken: set[str] = set()
    unique = []
    for name in names:
        path, choice, number = PurePosixPath(name), name, 1
        while _key(choice) in taken:
            number += 1
            choice = path.with_name(f"{path.stem}_{number}{path.suffix}").as_posix()
        taken.add(_key(choice))
        unique.append(choice)
    return unique


def _key(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()
