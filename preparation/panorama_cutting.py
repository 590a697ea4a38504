"""Panorama cutting: panoramas among photos and frames become views of a pinhole camera."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Literal

from gsfw.core.errors import ConfigError, DataError
from gsfw.core.files.atomic import readable_write_errors, write_atomically
from gsfw.core.progress import tracked
from gsfw.core.words import capitalized, counted, listed
from gsfw.datamanagers.images import Header, decode, decode_mask
from gsfw.datamanagers.warp import MapCache
from gsfw.preparation.choices import Choices
from gsfw.preparation.disk import check_space
from gsfw.preparation.exif import Exif
from gsfw.preparation.foreign_formats import STITCH
from gsfw.preparation.image_file import unique_names
from gsfw.preparation.image_set import ImageSet, LeftOut, SourceImage, ViewOfPanorama
from gsfw.preparation.journal import identity_of, short_key
from gsfw.preparation.panorama import Kind, Look, look_at, said_kind
from gsfw.preparation.panorama_masks import PanoramaMasks, cut_masks
from gsfw.preparation.panorama_views import (
    AROUND,
    DIRECTIONS,
    SMALLEST,
    continued,
    cut,
    has_proportions,
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
PIXEL_BYTES = {".jpg": 1.0, ".png": 4.0}
"""Bytes of a pixel of a view, at most: 0.8 as JPEG in views of a room full of texture; PNG files
have alpha, and may be no smaller than their pixels."""
REASONS = {
    Kind.FISHEYES: ("it shows two circles of fisheye lenses", STITCH),
    Kind.PART: (
        "it is a panorama of a part of all directions",
        "Export all directions (equirectangular, 2:1) if the camera has recorded them, or "
        "leave it out. panoramas=false uses it as an ordinary image, which suits narrow ones only.",
    ),
    Kind.STEREO: (
        "it is a stereo panorama, with an image for each eye",
        "Export the panorama of one eye (equirectangular, 2:1).",
    ),
    Kind.CUBE: (
        "its metadata call it a cube map, with six views in one image",
        "Export the video as equirectangular (2:1); panoramas=false uses its frames as ordinary "
        "images.",
    ),
}
"""Reasons and remedies of images that are left out."""
HIDDEN = LeftOut(
    "",
    "its mask hides all views of it",
    "Masks are bright where pixels count; invert this one if it is dark there.",
)
"""Reason and remedy of a panorama without a view."""
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
    masks: PanoramaMasks = field(default_factory=PanoramaMasks)

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
        ConfigError: all should be panoramas, and no image has their proportions; or there are
            masks of panoramas, and no panorama.
        DataError: there is nothing left that could be used, or a mask cannot be used.
        OutputError: a view cannot be written, or the disk has no room for all.
    """
    kinds = _kinds(images, rule)
    panoramas = [one for one in images.images if kinds.get(one.name) is Kind.PANORAMA]
    left_out = [
        LeftOut(one.name, *REASONS[kinds[one.name]])
        for one in images.images
        if kinds.get(one.name) in REASONS
    ]
    if rule.panoramas == "true" and not (panoramas or left_out):
        raise ConfigError(
            "panoramas=true: no image is twice as wide as high, as panoramas of all directions "
            "are.",
            "Leave it out, or export whole panoramas (equirectangular).",
        )
    lost = {item.name for item in left_out}
    masks = rule.masks.find(panoramas)
    views, lost_ones = _cut(panoramas, masks, rule, folder)
    left_out += lost_ones
    own = [views.get(one.name, [one]) for one in images.images if one.name not in lost]
    found = [view for group in own for view in group]
    if not found:
        first, names = left_out[0], listed([item.name for item in left_out], 1)
        raise DataError(
            f"{names}: there is no image that can be used. {capitalized(first.reason)}.",
            first.advice,
        )
    cut_ones = [one for one in panoramas if views[one.name]]
    if cut_ones:
        choices.choose("panoramas", _words(cut_ones, views, masks, rule))
    return replace(images, images=_named(found), left_out=(*images.left_out, *left_out))


def _named(images: Sequence[SourceImage]) -> tuple[SourceImage, ...]:
    """The images with unique names; views give way to the user's own."""
    order = sorted(range(len(images)), key=lambda number: images[number].view is not None)
    names = dict(zip(order, unique_names(images[number].name for number in order), strict=True))
    return tuple(replace(one, name=names[number]) for number, one in enumerate(images))


def _kinds(images: ImageSet, rule: PanoramaRule) -> dict[str, Kind]:
    """Kinds of the images that are no ordinary views, by name."""
    if rule.panoramas == "false":
        return {}
    likely = [one for one in images.images if _may_be(one)]
    if rule.panoramas == "true":
        return {one.name: kind for one in likely if (kind := _wanted_kind(one)) is not None}
    found = {one.name: one.said for one in likely if one.said is not None}
    alike: dict[tuple[str, int, int], list[SourceImage]] = {}
    for one in likely:
        if one.name in found:
            continue
        alike.setdefault((one.group, one.header.width, one.header.height), []).append(one)
    for members in alike.values():
        found |= _kinds_of(members)
    return found


def _may_be(image: SourceImage) -> bool:
    # Metadata may tell that an image of any proportions is a part of a panorama.
    is_photo = image.time is None
    is_likely = (
        is_photo
        or image.said is not None
        or has_proportions(image.header.width, image.header.height)
    )
    return is_likely and image.header.width >= SMALLEST


def _wanted_kind(image: SourceImage) -> Kind | None:
    """The kind of an image of which the user says that it is a panorama if it can be one."""
    kind = said_kind(image.path, image.header) if image.time is None else image.said
    if kind is None and has_proportions(image.header.width, image.header.height):
        return Kind.PANORAMA
    return kind


def _kinds_of(members: Sequence[SourceImage]) -> dict[str, Kind]:
    """Kinds of images of one size and origin, which are alike unless metadata tell otherwise."""
    step = 1 if members[0].time is None else -(-len(members) // LOOKED_AT)
    looks: dict[str, Look] = {one.name: look_at(one.path, one.header) for one in members[::step]}
    said = {name: look.kind for name, look in looks.items() if look.is_said}
    counts = Counter(look.kind for look in looks.values())
    for kind in (Kind.PANORAMA, Kind.FISHEYES):
        if counts[kind] > MOST * counts.total():
            return {**{one.name: kind for one in members}, **said}
    return said


def _words(
    panoramas: Sequence[SourceImage],
    views: Mapping[str, Sequence[SourceImage]],
    masks: Mapping[str, Path],
    rule: PanoramaRule,
) -> str:
    """The sentence about what was cut."""
    count = len(panoramas)
    sides = sorted({view_side(one.header.width) for one in panoramas})
    size = f"{sides[0]}x{sides[0]}" if len(sides) == 1 else f"{sides[0]} to {sides[-1]}"
    verb, they = ("is", "it") if count == 1 else ("are", "them")
    masked = sum(one.name in masks for one in panoramas)
    how = f", and so {'is its mask' if count == 1 else 'are their masks'}" if masked else ""
    if 0 < masked < count:
        how = f"; masks were found for {masked} of {they}"
    number = sum(len(views[one.name]) for one in panoramas)
    if hidden := count * rule.count - number:
        how += f"; {counted(hidden, 'view')} without a pixel that counts left out"
    how += "" if rule.panoramas == "true" else f"; panoramas=false uses {they} uncut"
    return (
        f"panoramas: {counted(count, 'panorama')} {verb} cut into "
        f"{counted(number, 'view')} of 90 degrees and {size} pixels{how}."
    )


def _cut(
    panoramas: Sequence[SourceImage], masks: dict[str, Path], rule: PanoramaRule, folder: Path
) -> tuple[dict[str, list[SourceImage]], list[LeftOut]]:
    """Views by the names of their panoramas, and panoramas without a view.

    Those do not decode, or their masks hide all of them. Views without a pixel that counts are left
    out. Files of other panoramas, and of earlier versions of these, are removed.
    """
    files = {one.name: _files(one, rule, folder) for one in panoramas}
    mask_files = cut_masks(panoramas, masks, rule.count, folder)
    missing = [one for one in panoramas if not all(map(Path.is_file, files[one.name]))]
    lost = _write_all(missing, files, rule, folder) if missing else []
    damaged = {item.name for item in lost}
    used = {file for group in (*files.values(), *mask_files.values()) for file in group}
    with readable_write_errors(folder):
        for file in set(folder.glob("*")) - used:
            file.unlink()
    # Panoramas may share a mask, whose views are decoded once.
    counts = {file: bool(decode_mask(file).any()) for file in set().union(*mask_files.values())}
    views: dict[str, list[SourceImage]] = {name: [] for name in damaged}
    for one in (one for one in panoramas if one.name not in damaged):
        found = _views(one, files[one.name], mask_files.get(one.name, [None] * rule.count))
        views[one.name] = [view for view in found if view.mask is None or counts[view.mask]]
        if not views[one.name]:
            lost.append(replace(HIDDEN, name=one.name))
    return views, lost


def _write_all(
    panoramas: Sequence[SourceImage],
    files: Mapping[str, Sequence[Path]],
    rule: PanoramaRule,
    folder: Path,
) -> list[LeftOut]:
    """Cut the views that are not there; panoramas that do not decode."""
    size = sum(
        rule.count * view_side(one.header.width) ** 2 * PIXEL_BYTES[_suffix(one)]
        for one in panoramas
    )
    check_space(folder, round(2 * size), "views of panoramas and the data set")
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
    key = short_key([VERSION, *identity_of(panorama.path)])
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


def _views(
    panorama: SourceImage, files: Sequence[Path], masks: Sequence[Path | None]
) -> list[SourceImage]:
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
            mask=mask,
        )
        for number, (direction, file, mask) in enumerate(
            zip(DIRECTIONS, files, masks, strict=False)
        )
    ]
