"""Source: the images and videos that the user gave, and why other files are not used."""

from __future__ import annotations

import statistics
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from gsfw.core.errors import DataError
from gsfw.core.words import counted, listed
from gsfw.datamanagers.color_profile import color_notes
from gsfw.datamanagers.detection import PHOTOS, VIDEOS
from gsfw.datamanagers.video import is_video
from gsfw.preparation.disk import find_copies
from gsfw.preparation.exif import read_exif
from gsfw.preparation.finding import remedies
from gsfw.preparation.foreign_formats import AVIF, BRANDS, BY_EXTENSION, HEIC, MISNAMED_VIDEO, RAW
from gsfw.preparation.image_file import (
    KNOWN,
    ImageFile,
    empty,
    examine,
    has_right_suffix,
    unique_names,
    with_right_suffix,
)
from gsfw.preparation.image_set import ImageSet, LeftOut, SourceImage
from gsfw.preparation.input_files import InputFile, InputFiles, name_order, shot
from gsfw.preparation.photo_conversion import Converted, with_jpeg

LIVE_CLIP = ".mov"
"""iPhones write such clips beside photos; other cameras put posters of the name beside videos."""
FOREIGN = {
    kind.reason: kind.name for kind in (*BY_EXTENSION.values(), *BRANDS.values(), MISNAMED_VIDEO)
}
"""Names of the formats that are not read, by the reason why files of them are left out."""
SMALL = 0.25
"""Images whose longer edge is a smaller part of the median one may be thumbnails."""


@dataclass(frozen=True)
class Source:
    """The inputs of a preparation."""

    images: ImageSet
    """The photos; frames of the videos are not among them yet."""
    videos: tuple[Path, ...]
    notes: tuple[str, ...]
    """Notes on the choice for the user; clauses without a period."""


def read_source(
    paths: Sequence[Path], apart: Sequence[Path] = (), converted: Path | None = None
) -> Source:
    """Find what can be used among the inputs, by the headers of files.

    Args:
        paths: folders, which are searched through, images, and videos.
        apart: results and masks; not looked at, should they lie in one of the folders.
        converted: folder for JPEG files of HEIC and AVIF photos; ``None`` leaves those out.

    Raises:
        DataError: a path is not there or cannot be read, or nothing can be used.
        OutputError: a converted photo cannot be written.
    """
    inputs = InputFiles.find(paths, apart)
    photos = Converted(tuple(inputs.files))
    if converted is not None:
        photos = with_jpeg(inputs.files, converted)
    videos, left_out = _videos(photos.files)
    looks = _examined(photos.files)
    left_out += photos.damaged
    left_out += [look for look in looks.values() if isinstance(look, LeftOut)]
    found = [look for look in looks.values() if isinstance(look, ImageFile)]
    others = [file for file, look in looks.items() if look is None]
    copies = find_copies([*videos, *(image.file for image in found)])
    for copy, original in copies.items():
        # Videos of several folders may have the same name.
        same = original.name if original.name != copy.name else original.path
        left_out.append(LeftOut(copy.name, f"it is the same file as {same}"))
    videos = [video for video in videos if video not in copies]
    found = [image for image in found if image.file not in copies]
    if not found and not videos:
        raise _nothing(paths, left_out, others)
    images = _images(found)
    left_out = _without_shots_in_use(left_out, [image.file for image in found])
    left_out.sort(key=lambda item: name_order(item.name))
    ordered = sorted(images, key=lambda image: name_order(image.name))
    return Source(
        ImageSet(tuple(ordered), tuple(left_out)),
        tuple(video.path for video in videos),
        (*inputs.notes, *photos.notes, *notes_on(found, images, others)),
    )


def _videos(files: Sequence[InputFile]) -> tuple[list[InputFile], list[LeftOut]]:
    """Videos to use, and others; a live photo is a photo and a clip of the same name."""
    photos = {shot(file.name): file for file in files if file.path.suffix.lower() in PHOTOS}
    videos, left_out = [], []
    for file in files:
        if not is_video(file.path):
            continue
        photo = photos.get(shot(file.name))
        if file.path.stat().st_size == 0:
            left_out.append(empty(file))
        elif photo is not None and file.path.suffix.lower() == LIVE_CLIP and not file.asked:
            reason = f"it is the clip of the live photo {photo.name}"
            left_out.append(LeftOut(file.name, reason, "Name the file as an input to use it."))
        else:
            videos.append(file)
    return videos, left_out


def _examined(files: Sequence[InputFile]) -> dict[InputFile, ImageFile | LeftOut | None]:
    with warnings.catch_warnings():
        # Pillow warns of damaged Exif, which is as good as none, and of large images.
        warnings.simplefilter("ignore")
        return {file: examine(file) for file in files if not is_video(file.path)}


def _images(found: Sequence[ImageFile]) -> list[SourceImage]:
    """Images under the names that they have in the result, in the order of ``found``."""
    names = unique_names(with_right_suffix(look.file.name, look.content) for look in found)
    folders = {_folder(name) for name in names}
    return [
        SourceImage(
            name=name,
            path=look.file.path,
            header=look.header,
            exif=read_exif(look.file.path),
            group=_folder(name) if len(folders) > 1 else "",
        )
        for name, look in zip(names, found, strict=True)
    ]


def _folder(name: str) -> str:
    parent = PurePosixPath(name).parent
    return "" if parent == PurePosixPath() else parent.as_posix()


def _without_shots_in_use(left_out: Sequence[LeftOut], used: Sequence[InputFile]) -> list[LeftOut]:
    """Leave out the advice for RAW, HEIC and AVIF files that have a JPEG file of the same shot."""
    shots = {shot(file.name): file.name for file in used}
    foreign = (RAW.reason, HEIC.reason, AVIF.reason)
    return [
        replace(item, reason=f"{item.reason}; {shots[shot(item.name)]} is used", advice="")
        if item.reason in foreign and shot(item.name) in shots
        else item
        for item in left_out
    ]


def _nothing(
    paths: Sequence[Path], left_out: Sequence[LeftOut], others: Sequence[InputFile]
) -> DataError:
    """The error where nothing can be used: what there is instead, the most frequent first."""
    reasons = Counter(item.reason for item in left_out)
    foreign = [
        counted(count, f"{FOREIGN[reason]} file")
        for reason, count in reasons.most_common()
        if reason in FOREIGN
    ]
    counts = [f"{' and '.join(foreign)}, which it does not read"] if foreign else []
    if others:
        verb = "is" if len(others) == 1 else "are"
        files = counted(len(others), "file")
        counts.append(f"{files} that {verb} no image and no video, by name and content")
    found = [f"gsfw found {'; and '.join(counts)}."] if counts else []
    for reason in (reason for reason, _ in reasons.most_common() if reason not in FOREIGN):
        names = tuple(item.name for item in left_out if item.reason == reason)
        found.append(f"{listed(names)}: {reason}.")
    advice = remedies((item.name, item.advice) for item in left_out if item.advice)
    return DataError(
        f"{listed([str(path) for path in paths])}: there is no image and no video that can "
        f"be used. {' '.join(found or ['There are no files.'])}",
        "\n".join(
            advice or [f"Give a folder of {KNOWN} images, or a video ({', '.join(VIDEOS)})."]
        ),
    )


def notes_on(
    found: Sequence[ImageFile], images: Sequence[SourceImage], others: Sequence[InputFile]
) -> Iterator[str]:
    """Clauses without a period.

    Args:
        found: files that hold images.
        images: what became of each.
        others: files that do not claim to be images.
    """
    names = {look.file: image.name for look, image in zip(found, images, strict=True)}
    misnamed = [look for look in found if not has_right_suffix(look.file.name, look.content)]
    if misnamed:
        renamed = tuple(f"{look.file.name} -> {names[look.file]}" for look in misnamed)
        yield f"named by content, not by extension: {listed(renamed)}"
    clashing = tuple(
        f"{look.file.name} -> {names[look.file]}"
        for look in found
        if look not in misnamed and look.file.name != names[look.file]
    )
    if clashing:
        yield f"renamed, since some disks take two names for one: {listed(clashing)}"
    paged = tuple(f"{look.file.name} ({look.pages})" for look in found if look.pages > 1)
    if paged:
        yield f"the first image is used of files that hold several: {listed(paged)}"
    yield from color_notes((image.name, image.header.unconverted) for image in images)
    yield from _on_small(images)
    if others:
        kinds = tuple(sorted({file.path.suffix.lower() or "no extension" for file in others}))
        yield f"files that hold no image are not used: {len(others)} ({listed(kinds)})"


def _on_small(images: Sequence[SourceImage]) -> Iterator[str]:
    if not images:
        return
    edges = [max(image.header.width, image.header.height) for image in images]
    median = statistics.median_low(edges)
    small = tuple(
        f"{image.name} ({image.header.width}x{image.header.height})"
        for image, edge in zip(images, edges, strict=True)
        if edge < SMALL * median
    )
    if small:
        yield (
            f"much smaller than the usual {median} pixels, perhaps thumbnails, which are better "
            f"removed: {listed(small)}"
        )
