"""Panorama: which images show all directions, by their metadata or by their pixels.

Metadata of photos are those of Google's photo spheres (https://developers.google.com/streetview/
spherical-metadata), which cameras of 360 degrees and stitching programs write; those of videos are
Google's Spherical Video (https://github.com/google/spatial-media, versions 1 and 2).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
from jaxtyping import Float32, UInt8
from PIL import Image

from gsfw.core.errors import DataError
from gsfw.core.files.bounded_file import BoundedFile
from gsfw.datamanagers.area import shrink
from gsfw.datamanagers.images import FORMATS, Header, decode
from gsfw.datamanagers.video_traits import VideoTraits
from gsfw.preparation.panorama_views import ODD, has_proportions

EQUIRECTANGULAR = b"equirectangular"
"""The value of GPano:ProjectionType in the XMP data of panoramas."""
SIZES = ("CroppedAreaImageWidthPixels", "FullPanoWidthPixels")
SIZES_DOWN = ("CroppedAreaImageHeightPixels", "FullPanoHeightPixels")
"""GPano's names of the size of what is there, and of all directions."""
EQUIRECTANGULAR_VIDEO, CUBE_MAP, EQUIRECTANGULAR_PARTS = 0, 1, (2, 3)
"""FFmpeg's numbers of projections (AVSphericalProjection); the last ones are tiles and halves."""
SMALL = (256, 128)
"""Width and height to which an image is shrunk before its pixels are compared."""
BAND = 16
"""Columns on each side of the seam of a panorama that are compared with the seam."""
JOINED, APART = 3.2, 0.7
"""The left and right edges of a panorama differ by less than this many times the difference of
neighbouring columns, and than this part of the difference from columns ``BAND`` away. Measured in
56 real panoramas: 0.2 to 3.0 (the edge of a door at the seam), and 0.03 to 0.6."""
PLAIN = 4.0
"""Difference of columns, of 255, below which edges look alike for lack of content."""
DETAIL, DETAILED = 0.5, 0.1
"""Rows with detail at the edges, in parts of those of all columns and of all rows, at least: edges
of a smooth backdrop, or of a plain floor from the middle of its side, are alike without being
joined. A row has detail if its second difference along a column is above ``PLAIN``."""
POLE, PATCH = 0.3, 1.0
"""Differences along the top and bottom rows, each of which is one point of the sphere, in parts of
those of all rows, at most: of one of them, and of the other, which may show a patch over the tripod
(real panoramas: up to 0.8). Of 2,214 parts of photos and renders of 2:1, none is within these."""
BLACK = 12.0
"""Mean level, of 255, of what lies around the circles of two fisheyes, at most."""
BRIGHTER = 3.0
"""Ratio of the levels along and around the circles, at least."""


class Kind(Enum):
    """The content of an image."""

    VIEW = "view"
    """The view of a camera with one lens."""
    PANORAMA = "panorama"
    """All directions, equirectangular."""
    PART = "part of a panorama"
    """Some directions, equirectangular."""
    STEREO = "stereo panorama"
    """All directions for each eye, in one image."""
    CUBE = "cube map"
    """All directions, as six views in one image."""
    FISHEYES = "two fisheyes"
    """Two circles, as a camera with two lenses sees them before they are stitched."""


@dataclass(frozen=True)
class Look:
    """The kind of an image, and whether its metadata or its pixels tell it."""

    kind: Kind
    is_said: bool = False


def look_at(path: Path, header: Header) -> Look:
    """The kind of an image, as far as can be told; ``Kind.VIEW`` where it cannot be read."""
    kind = said_kind(path, header)
    if kind is not None:
        return Look(kind, is_said=True)
    if header.width != 2 * header.height or header.width < SMALL[0]:
        return Look(Kind.VIEW)
    try:
        # JPEG decodes at a power of two, other formats whole; limits hold for one size.
        pixels = shrink(decode(path, header, SMALL), *SMALL)[..., :3]
    except DataError:
        return Look(Kind.VIEW)
    if _are_circles(pixels):
        return Look(Kind.FISHEYES)
    return Look(Kind.PANORAMA if _is_joined(pixels) else Kind.VIEW)


def said_kind(path: Path, header: Header) -> Kind | None:
    """The kind that XMP data tell, where the proportions agree; else ``None``."""
    try:
        with BoundedFile(path) as file, Image.open(file, formats=FORMATS) as image:
            xmp = image.info.get("xmp", b"")
    except Exception:  # Pillow raises whatever a broken file makes it.
        return None
    text = xmp if isinstance(xmp, bytes) else str(xmp).encode()
    if EQUIRECTANGULAR not in text:
        return None
    (width, full_width), (height, full_height) = (
        [_number(text, name) for name in names] for names in (SIZES, SIZES_DOWN)
    )
    is_part = (width, height) != (full_width, full_height)
    if is_part and 0 not in (width, height, full_width, full_height):
        # A view that was cut out may have kept the data of its panorama.
        is_whole_file = abs(width * header.height - height * header.width) <= ODD * width * height
        return Kind.PART if is_whole_file else None
    if header.width == header.height == full_width == full_height:
        return Kind.STEREO
    return Kind.PANORAMA if has_proportions(header.width, header.height) else None


def kind_of_video(traits: VideoTraits) -> Kind | None:
    """The kind of a video's images that its metadata tell; ``None`` where they tell nothing."""
    if traits.projection == CUBE_MAP:
        return Kind.CUBE
    if traits.projection in EQUIRECTANGULAR_PARTS:
        return Kind.PART
    if traits.projection != EQUIRECTANGULAR_VIDEO:
        return None
    if traits.stereo:
        return Kind.STEREO
    return Kind.PANORAMA if has_proportions(*traits.shown_size) else None


def _number(xmp: bytes, name: str) -> int:
    """A number of GPano, as an attribute or an element; 0 where it is not there."""
    found = re.search(rb"GPano:%s\s*(?:=\s*[\"']|>)\s*(\d{1,9})" % name.encode(), xmp)
    return int(found.group(1)) if found else 0


def _are_circles(pixels: UInt8[np.ndarray, "h w 3"]) -> bool:
    """True if both halves are black around a circle that touches their edges."""
    height, width = pixels.shape[:2]
    y, x = np.mgrid[:height, : width // 2] + 0.5
    across, down = x / (width / 4) - 1, y / (height / 2) - 1
    radius = np.hypot(across, down)
    ring = (radius > 0.8) & (radius < 0.95)
    flat = np.abs(across) > np.abs(down)
    sides = [ring & part for part in (flat & (across < 0), flat & (across > 0))]
    sides += [ring & part for part in (~flat & (down < 0), ~flat & (down > 0))]
    for half in (pixels[:, : width // 2], pixels[:, width - width // 2 :]):
        around = half[radius > 1.05].mean()
        inside = min(half[side].mean() for side in sides)
        if around > BLACK or inside < BRIGHTER * max(around, 1.0):
            return False
    return True


def _is_joined(pixels: UInt8[np.ndarray, "h w 3"]) -> bool:
    """True if the left edge continues the right one, and the top or bottom row shows a point.

    Panoramas are missed rather than photos cut: these would spoil a capture.
    """
    values: Float32[np.ndarray, "h w 3"] = pixels.astype(np.float32)
    seam = np.roll(values, BAND, axis=1)[:, : 2 * BAND]
    steps = np.abs(np.diff(seam, axis=1)).mean(axis=(0, 2))
    across, beside = steps[BAND - 1], np.delete(steps, BAND - 1).mean()
    away = np.abs(seam[:, [0, -1]] - seam[:, [BAND, BAND - 1]]).mean()
    fine = (np.abs(np.diff(values, 2, axis=0)).mean(axis=2) > PLAIN).mean(axis=0)
    rows = np.abs(np.diff(values, axis=1)).mean(axis=(1, 2))
    return bool(
        away > PLAIN
        and across < min(JOINED * beside, APART * away)
        and fine[[0, -1]].mean() > max(DETAIL * fine.mean(), DETAILED)
        and min(rows[0], rows[-1]) < POLE * rows.mean()
        and max(rows[0], rows[-1]) < PATCH * rows.mean()
    )
