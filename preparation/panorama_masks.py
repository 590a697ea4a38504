"""Panorama masks: the parts of panoramas that count, cut into views as the panoramas are.

The camera's operator is at the same place in all panoramas of a walk, so that one mask serves all.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from gsfw.core.config import AUTO
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.reading import followed
from gsfw.core.progress import tracked
from gsfw.datamanagers.images import decode_mask
from gsfw.datamanagers.mask_folder import MaskFolder, stem_of
from gsfw.datamanagers.masks import FOLDER, NONE, Folders
from gsfw.preparation.image_set import SourceImage
from gsfw.preparation.input_files import IMAGE_FOLDERS
from gsfw.preparation.journal import identity_of, short_key
from gsfw.preparation.panorama_views import DIRECTIONS, cut_mask, has_proportions, view_side
from gsfw.preparation.writing.image_output import encoded_mask

SETTING = "panorama_masks"
VERSION = 1
"""Number of the way of cutting; files of another are not used again."""


@dataclass(frozen=True)
class PanoramaMasks:
    """The masks of panoramas, bright where pixels count."""

    source: str = AUTO
    """auto (``masks`` beside the panoramas), none, a folder with a mask for each, or one image for
    all."""

    @property
    def path(self) -> Path | None:
        """The folder or image that the user named; ``None`` where there is none."""
        return None if self.source in (AUTO, NONE) else Path(self.source)

    def check(self, inputs: Sequence[Path]) -> None:
        """Look at the path that the user named, before anything is decoded.

        Args:
            inputs: folders and files of photos and videos.

        Raises:
            ConfigError: it is a folder of images itself.
            DataError: it is missing.
        """
        if self.path is None:
            return
        if not self.path.exists():
            raise DataError(
                f"{SETTING}={self.path}: there is no such file or folder.",
                "Give one image for all panoramas, or a folder with a mask for each.",
            )
        folders = {followed(path / name) for path in inputs for name in ("", *IMAGE_FOLDERS)}
        if followed(self.path) in folders:
            raise ConfigError(
                f"{SETTING}={self.path}: this is a folder of input images, and images of a folder "
                "of masks are not used as photos.",
                "Put the masks into a folder of their own, and name that.",
            )

    def find(self, panoramas: Sequence[SourceImage]) -> dict[str, Path]:
        """The masks by the names of their panoramas.

        Raises:
            ConfigError: the user named masks, and there is no panorama.
            DataError: the folder that the user named contains no mask of a panorama.
        """
        if self.source == NONE:
            return {}
        if self.path is None:
            folders: Folders = {}
            found = {one.name: _beside(one, folders) for one in panoramas if one.time is None}
            return {name: mask for name, mask in found.items() if mask is not None}
        return self._named(self.path, panoramas)

    def _named(self, path: Path, panoramas: Sequence[SourceImage]) -> dict[str, Path]:
        if not panoramas:
            raise ConfigError(
                f"{SETTING}={path}: no image is cut as a panorama.",
                "Leave it out, or cut all images that are twice as wide as high (panoramas=true).",
            )
        if not path.is_dir():
            return {one.name: path for one in panoramas}
        folder = MaskFolder(path)
        names = _short_names([one.name for one in panoramas])
        found = {name: folder.find(own) for name, own in names.items()}
        masks = {name: mask for name, mask in found.items() if mask is not None}
        if not masks:
            name = names[panoramas[0].name][-1].as_posix()
            raise DataError(
                f"{SETTING}={path}: the folder contains no mask of any panorama (looked for "
                f"{name}.png or {PurePosixPath(name).with_suffix('.png')}, in any image format).",
                "Name masks as their panoramas, or give one image for all of them.",
            )
        return masks


def _short_names(names: Sequence[str]) -> dict[str, list[Path]]:
    """Each name with the folders in front, and without those that it needs not to be unique."""
    parts = {name: PurePosixPath(name).parts for name in names}
    ends = {name: [Path(*own[first:]) for first in range(len(own))] for name, own in parts.items()}
    counts = Counter(stem_of(end) for own in ends.values() for end in own)
    return {
        name: [end for end in own if end is own[0] or counts[stem_of(end)] == 1]
        for name, own in ends.items()
    }


def _beside(panorama: SourceImage, folders: Folders) -> Path | None:
    """The mask in a folder of masks beside a photo, or beside a folder that it is in."""
    for folder in panorama.path.parents[: len(PurePosixPath(panorama.name).parts)]:
        name = panorama.path.relative_to(folder)
        places = [folder, folder.parent] if folder.name in IMAGE_FOLDERS else [folder]
        for place in places:
            path = place / FOLDER
            found = folders.setdefault(path, MaskFolder(path)).find([name])
            if found is not None:
                return found
    return None


def cut_masks(
    panoramas: Sequence[SourceImage], masks: dict[str, Path], count: int, folder: Path
) -> dict[str, list[Path]]:
    """The masks of views by the names of their panoramas; those that were cut before are kept.

    Args:
        panoramas: all of them.
        masks: by name, of those that have one; panoramas of one size may share a mask.
        count: number of views of a panorama.
        folder: for the files.

    Raises:
        DataError: a mask does not decode, or has not the proportions of a panorama.
        OutputError: a file cannot be written.
    """
    masked = [one for one in panoramas if one.name in masks]
    files = {one.name: _files(one, masks[one.name], count, folder) for one in masked}
    missing = {
        files[one.name][0]: one for one in masked if not all(map(Path.is_file, files[one.name]))
    }
    for one in tracked(list(missing.values()), "cutting masks", len(missing)):
        for file, content in zip(files[one.name], _cut(one, masks[one.name]), strict=False):
            write_atomically(file, content)
    return files


def _files(panorama: SourceImage, mask: Path, count: int, folder: Path) -> list[Path]:
    header = panorama.header
    key = short_key([VERSION, *identity_of(mask), header.width, header.height])
    return [folder / f"{key}_{one.name}_mask.png" for one in DIRECTIONS[:count]]


def _cut(panorama: SourceImage, mask: Path) -> Iterator[bytes]:
    """The masks of all views as PNG, in the order of the directions."""
    inside = decode_mask(mask)
    height, width = inside.shape
    if not has_proportions(width, height):
        raise DataError(
            f"{mask}: the mask is {width}x{height} pixels, and its panorama {panorama.path} is "
            f"{panorama.header.width}x{panorama.header.height}.",
            "A mask needs the proportions of its panorama, 2:1; its size may be smaller.",
        )
    for direction in DIRECTIONS:
        yield encoded_mask(cut_mask(inside, view_side(panorama.header.width), direction))
