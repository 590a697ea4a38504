"""MaskFolder: the files of a folder of masks, and the image that the name of each belongs to."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from posixpath import join, split, splitext

from gsfw.core.files.reading import is_file
from gsfw.datamanagers.images import MASK_EXTENSIONS

AFFIX = re.compile(r"^masks?[-_. ]+|[-_. ]+(masks?|matte|seg|segmentation)$", re.IGNORECASE)
"""Prefixes and suffixes of the image's name: mask_a, a_mask, a.mask, a-seg."""


@dataclass(frozen=True)
class MaskFolder:
    """A folder, which need not exist."""

    path: Path

    @cached_property
    def files(self) -> tuple[Path, ...]:
        """Paths of its images and of those in subfolders, relative to the folder; sorted."""
        if not self.path.is_dir():
            return ()
        found = (file for file in self.path.rglob("*") if file.is_file())
        relative = (file.relative_to(self.path) for file in found)
        return tuple(sorted(file for file in relative if is_mask_file(file)))

    @cached_property
    def _by_stem(self) -> dict[str, list[Path]]:
        stems: dict[str, list[Path]] = {}
        for file in self.files:
            stems.setdefault(stem_of(file), []).append(file)
        return stems

    def find(self, names: Iterable[Path], other_than: Path | None = None) -> Path | None:
        """The mask of an image; ``None`` if there is none.

        NAME.jpg.png as in COLMAP, then NAME.png, then the image's own name come first, and then
        whatever else has its name in any image format.

        Args:
            names: of the image, relative to its folder.
            other_than: a file that is no mask although its name is right.
        """
        for name in names:
            exact = (f"{name}.png", str(name.with_suffix(".png")), str(name))
            alike = map(str, self._by_stem.get(stem_of(name), ()))
            for file in (*exact, *alike):
                place = self.path / file
                if place != other_than and is_file(place):
                    return place
        return None


def is_mask_file(file: Path) -> bool:
    """True if a file's extension is one of an image format, and it is not hidden."""
    return file.suffix.lower() in MASK_EXTENSIONS and not file.name.startswith(".")


def stem_of(file: Path) -> str:
    """Name that an image and its mask have in common, with their folders; in lower case."""
    path = file.as_posix()
    while splitext(path)[1].lower() in MASK_EXTENSIONS:
        path = splitext(path)[0]
    folder, name = split(path)
    return join(folder, AFFIX.sub("", name) or name).lower()
