"""Panorama cutting: panoramas among photos and frames become views of a pinhole camera."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Literal

from gsfw.core.errors import ConfigError, DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.progress import tracked
from gsfw.datamanagers.images import Header, decode
from gsfw.datamanagers.warp import MapCache
from gsfw.preparation.choices import Choices
from gsfw.preparation.disk import check_space
from gsfw.preparation.exif import Exif
from gsfw.preparation.foreign_formats import STITCH
from gsfw.preparation.image_file import unique_names
from gsfw.preparation.image_set import ImageSet, LeftOut, SourceImage, ViewOfPanorama
from gsfw.preparation.journal import identity_of
from gsfw.preparation.panorama import Kind, Look, is_twice_as_wide, look_at
from gsfw.preparation.panorama_views import (
    AROUND,
    DIRECTIONS,
    SMALLEST,
    continued,
    cut,
    map_bytes,
    view_side,
)
from gsfw.preparation.video_frames import JPEG_QUALITY
from gsfw.preparation.writing.image_output import encoded

MOST = 0.5
"""Part of the images of one size and folder or video that look like panoramas, from which on all of
them are: a seam may be seen in some."""
LOOKED_AT = 9
"""Frames of a video whose pixels are looked at."""
PIXEL_BYTES = 1.0
"""Bytes of a pixel of a view as JPEG, at most: 0.8 in views of a room full of texture."""
VERSION = 1
"""Number of the way of cutting; files of another are not used again."""


@dataclass(frozen=True)
class PanoramaRule:
    """The user's choices about images of all directions."""

    panoramas: Literal["auto", "true", "false"] = "auto"
    """Images that are cut: those whose metadata or pixels tell it, all that are twice as wide as
    high, or none."""
    views: Literal["around", "sphere"] = "around"
    """Six views around, or also one up and one down."""

    @property
    def count(self) -> int:
        """Number of views of a panorama."""
        return AROUND if self.views == "around" else len(DIRECTIONS)


def cut_panoramas(images: ImageSet, rule: PanoramaRule, folder: Path, choices: Choices) -> ImageSet:
    """The set with views in the place of panoramas; those that were cut before are kept.

    Args:
        images: all photos and frames.
        rule: which are panoramas, and which views are cut.
        folder: for the files of the views.
        choices: receives what was found.

    Raises:
        ConfigError: all should be panoramas, and no image has their proportions.
        DataError: there is nothing left that could be used.
        OutputError: a view cannot be written, or the disk has no room for all.
    """
    kinds = _kinds(images, rule)
    panoramas = [one for one in images.images if kinds.get(one.name) is Kind.PANORAMA]
    if rule.panoramas == "true" and not panoramas:
        raise ConfigError(
            "panoramas=true: no image is twice as wide as high, as panoramas of all directions "
            "are.",
            "Leave it out, or export whole panoramas (equirectangular).",
        )
    left_out = [
        _left_out(one, kinds[one.name])
        for one in images.images
        if kinds.get(one.name) not in (None, Kind.PANORAMA)
    ]
    lost = {item.name for item in left_out}
    views, damaged = _cut(panoramas, rule, folder)
    left_out += damaged
    own = [views.get(one.name, [one]) for one in images.images if one.name not in lost]
    found = [view for group in own for view in group]
    if not found:
        raise DataError(
            f"{left_out[0].name}{f' and {len(left_out) - 1} more' if left_out[1:] else ''}: there "
            f"is no image that can be used. {left_out[0].reason[:1].upper()}"
            f"{left_out[0].reason[1:]}.",
            left_out[0].advice,
        )
    if panoramas:
        choices.choose("panoramas", _words(panoramas, rule))
    names = unique_names(one.name for one in found)
    named = [replace(one, name=name) for one, name in zip(found, names, strict=True)]
    return replace(images, images=tuple(named), left_out=(*images.left_out, *left_out))


def _kinds(images: ImageSet, rule: PanoramaRule) -> dict[str, Kind]:
    """Kinds of the images that are no ordinary views, by name."""
    if rule.panoramas == "false":
        return {}
    likely = [one for one in images.images if _may_be(one, rule)]
    if rule.panoramas == "true":
        return {one.name: Kind.PANORAMA for one in likely}
    alike: dict[tuple[str, int, int], list[SourceImage]] = {}
    for one in likely:
        alike.setdefault((one.group, one.header.width, one.header.height), []).append(one)
    found: dict[str, Kind] = {}
    for members in alike.values():
        found |= _kinds_of(members)
    return found


def _may_be(image: SourceImage, rule: PanoramaRule) -> bool:
    if image.header.width < SMALLEST:
        return False
    # Metadata may tell that an image of any proportions is a part of a panorama.
    return is_twice_as_wide(image.header) or (rule.panoramas == "auto" and image.time is None)


def _kinds_of(members: Sequence[SourceImage]) -> dict[str, Kind]:
    """Kinds of images of one size and origin, which are alike unless metadata tell otherwise."""
    step = 1 if members[0].time is None else max(1, len(members) // LOOKED_AT)
    looks: dict[str, Look] = {one.name: look_at(one.path, one.header) for one in members[::step]}
    said = {name: look.kind for name, look in looks.items() if look.is_said}
    guessed = Counter(look.kind for look in looks.values() if not look.is_said)
    for kind in (Kind.PANORAMA, Kind.FISHEYES):
        if guessed[kind] > MOST * guessed.total():
            return {**{one.name: kind for one in members}, **said}
    return said


def _left_out(image: SourceImage, kind: Kind) -> LeftOut:
    if kind is Kind.FISHEYES:
        return LeftOut(image.name, "it shows two circles of fisheye lenses", STITCH)
    return LeftOut(image.name, "it is a panorama of a part of all directions", STITCH)


def _words(panoramas: Sequence[SourceImage], rule: PanoramaRule) -> str:
    """The sentence about what was cut."""
    count = len(panoramas)
    sides = sorted({view_side(one.header.width) for one in panoramas})
    size = f"{sides[0]}x{sides[0]}" if len(sides) == 1 else f"{sides[0]} to {sides[-1]}"
    images = f"{count} image{'s' if count > 1 else ''} of all directions"
    how = "" if rule.panoramas == "true" else " (panoramas=false: used as they are)"
    return (
        f"panoramas: {images} cut into {count * rule.count} views of 90 degrees and {size} pixels, "
        f"{rule.count} of each{how}."
    )


def _cut(
    panoramas: Sequence[SourceImage], rule: PanoramaRule, folder: Path
) -> tuple[dict[str, list[SourceImage]], list[LeftOut]]:
    """Views by the names of their panoramas, and panoramas that do not decode."""
    files = {one.name: _files(one, rule, folder) for one in panoramas}
    missing = [one for one in panoramas if not all(map(Path.is_file, files[one.name]))]
    damaged = _write_all(missing, files, rule, folder) if missing else []
    lost = {item.name for item in damaged}
    return {
        one.name: [] if one.name in lost else _views(one, files[one.name]) for one in panoramas
    }, damaged


def _write_all(
    panoramas: Sequence[SourceImage],
    files: Mapping[str, Sequence[Path]],
    rule: PanoramaRule,
    folder: Path,
) -> list[LeftOut]:
    """Cut the views that are not there; panoramas that do not decode."""
    pixels = sum(rule.count * view_side(one.header.width) ** 2 for one in panoramas)
    check_space(folder, round(2 * PIXEL_BYTES * pixels), "views of panoramas and the data set")
    maps = MapCache(map_bytes(max(one.header.width for one in panoramas), rule.count))
    damaged = []
    for one in tracked(panoramas, "cutting panoramas", len(panoramas)):
        try:
            _write(one, files[one.name], maps)
        except DataError as error:
            reason = error.message.removeprefix(f"{one.path}: ").rstrip(".")
            damaged.append(LeftOut(one.name, reason, "Replace the file, or remove it."))
    return damaged


def _files(panorama: SourceImage, rule: PanoramaRule, folder: Path) -> list[Path]:
    identity = repr([VERSION, *identity_of(panorama.path)]).encode()
    key = hashlib.blake2b(identity, digest_size=12).hexdigest()
    suffix = _suffix(panorama)
    return [folder / f"{key}_{one.name}{suffix}" for one in DIRECTIONS[: rule.count]]


def _suffix(panorama: SourceImage) -> str:
    """JPEG has no alpha."""
    return ".png" if panorama.header.has_alpha else ".jpg"


def _write(panorama: SourceImage, files: Sequence[Path], maps: MapCache) -> None:
    """Cut the views that are not there."""
    format_name = "PNG" if panorama.header.has_alpha else "JPEG"
    whole = continued(decode(panorama.path, panorama.header))
    for direction, file in zip(DIRECTIONS, files, strict=False):
        if not file.is_file():
            pixels = cut(whole, direction, maps)
            write_atomically(file, encoded(pixels, format_name, JPEG_QUALITY))


def _views(panorama: SourceImage, files: Sequence[Path]) -> list[SourceImage]:
    side = view_side(panorama.header.width)
    path = PurePosixPath(panorama.name)
    return [
        SourceImage(
            name=path.with_name(f"{path.stem}_{direction.name}{file.suffix}").as_posix(),
            path=file,
            header=Header(side, side, panorama.header.has_alpha),
            exif=Exif(),
            group=panorama.group,
            time=panorama.time,
            view=ViewOfPanorama(panorama.name, number, side / 2),
        )
        for number, (direction, file) in enumerate(zip(DIRECTIONS, files, strict=False))
    ]
