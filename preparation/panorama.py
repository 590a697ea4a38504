"""Panorama: photos of 360 degrees, which no camera of structure from motion describes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from gsfw.core.errors import DataError
from gsfw.core.files.bounded_file import BoundedFile
from gsfw.datamanagers.images import FORMATS, Header, decode
from gsfw.preparation.foreign_formats import CUT_PANORAMA
from gsfw.preparation.image_set import ImageSet

XMP = b"equirectangular"
"""The value of GPano:ProjectionType in the XMP data of panoramas."""
SMALL = (256, 128)
"""Width and height at which the edges of an image are compared."""
JOINED, APART = 2.0, 0.7
"""The left and right edges of a panorama differ by less than this many times the difference of
neighbouring columns, and than this part of the difference from columns elsewhere. Measured: 1.0 and
0.4 to 0.5 in the test's panorama; 3.2 and more, and 0.6 to 3.3, in 31 views of a pinhole."""
PLAIN = 4.0
"""Mean difference of columns, of 255, below which edges look alike for lack of content."""


def says_panorama(path: Path, header: Header) -> bool:
    """True if an image's XMP data say that it is a panorama, and its proportions agree."""
    if header.width != 2 * header.height:
        return False
    try:
        with BoundedFile(path) as file, Image.open(file, formats=FORMATS) as image:
            xmp = image.info.get("xmp", b"")
    except Exception:  # Pillow raises whatever a broken file makes it.
        return False
    return XMP in (xmp if isinstance(xmp, bytes) else str(xmp).encode())


def panorama_notes(images: ImageSet) -> Iterator[str]:
    """A note on images that look like panoramas, by the first of each folder and video."""
    for group, members in images.groups.items():
        first = members[0]
        if _looks_like_panorama(first.path, first.header):
            where = f" in {group}" if group else ""
            yield (
                f"images{where} look like panoramas of 360 degrees, which no camera model "
                f"describes, as the edges of {first.name} continue each other. {CUT_PANORAMA}"
            )


def _looks_like_panorama(path: Path, header: Header) -> bool:
    """True if an image has the proportions of a panorama, and its left edge continues its right."""
    if header.width != 2 * header.height or header.width < SMALL[0]:
        return False
    try:
        pixels = decode(path, header, SMALL)[..., :3]
    except DataError:
        return False
    columns = pixels.astype(np.float32)
    first, others = columns[:, :1], columns[:, columns.shape[1] // 4 :: 16]
    across = float(np.abs(columns[:, 0] - columns[:, -1]).mean())
    beside = float(np.abs(np.diff(columns, axis=1)).mean())
    usual = float(np.abs(first - others).mean())
    return usual > PLAIN and across < min(JOINED * beside, APART * usual)
