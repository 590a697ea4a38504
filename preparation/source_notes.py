"""Source notes: what the user may want to know of the pictures that were found."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence

from gsfw.preparation.finding import listed
from gsfw.preparation.input_files import InputFile
from gsfw.preparation.picture_file import PictureFile
from gsfw.preparation.picture_names import has_right_suffix
from gsfw.preparation.picture_set import SourcePicture

SMALL = 0.25
"""Pictures whose longer edge is a smaller part of the median one may be thumbnails."""


def notes_on(
    found: Sequence[PictureFile], pictures: Sequence[SourcePicture], others: Sequence[InputFile]
) -> Iterator[str]:
    """Clauses without a period.

    Args:
        found: files that hold pictures.
        pictures: what became of each.
        others: files that do not claim to be pictures.
    """
    names = {look.file: picture.name for look, picture in zip(found, pictures, strict=True)}
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
        yield f"the first picture is used of files that hold several: {listed(paged)}"
    yield from _on_small(pictures)
    if others:
        kinds = tuple(sorted({file.path.suffix.lower() or "no extension" for file in others}))
        yield f"files that hold no picture are not used: {len(others)} ({listed(kinds)})"


def _on_small(pictures: Sequence[SourcePicture]) -> Iterator[str]:
    if not pictures:
        return
    edges = [max(picture.header.width, picture.header.height) for picture in pictures]
    median = statistics.median_low(edges)
    small = tuple(
        f"{picture.name} ({picture.header.width}x{picture.header.height})"
        for picture, edge in zip(pictures, edges, strict=True)
        if edge < SMALL * median
    )
    if small:
        yield (
            f"much smaller than the usual {median} pixels, perhaps thumbnails, which are better "
            f"removed: {listed(small)}"
        )
