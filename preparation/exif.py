"""Exif: what a photo says of the camera that took it (CIPA DC-008, Exif 2.32)."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image
from PIL.ExifTags import IFD, Base

from gsfw.core.files.bounded_file import BoundedFile
from gsfw.datamanagers.images import FORMATS

FILM_DIAGONAL = 43.27
"""Millimetres. CIPA DCG-001 defines the 35 mm equivalent by diagonals of 36x24 mm film and of the
sensor, so it tells nothing of widths; COLMAP computes with this number as well."""

MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""Length of each FocalPlaneResolutionUnit: inch, centimetre, and by custom mm and micrometre."""

INCH = 2
"""The unit where none is given."""

PLAUSIBLE = (0.1, 50.0)
"""Focal lengths beyond, in longer edges of the image, are taken for nonsense: they would be a
view of 157 degrees, or a lens of 1,800 mm on film."""

DATE = re.compile(r"[12]\d{3}:\d\d:\d\d \d\d:\d\d:\d\d")
"""Cameras whose clock is not set write zeros or spaces."""


@dataclass(frozen=True)
class Exif:
    """Empty strings and ``None`` where the file says nothing."""

    make: str = ""
    model: str = ""
    lens: str = ""
    focal_mm: float | None = None
    """Focal length in millimetres."""
    focal_35mm: float | None = None
    """The focal length that would show as much on 36x24 mm film, in millimetres."""
    taken: str = ""
    """When, as "YYYY:MM:DD HH:MM:SS"."""
    pixels_per_mm: float | None = None
    """Pixels to a millimetre of the sensor, in the image as the camera wrote it."""
    longer_edge: int | None = None
    """Pixels, of the image as the camera wrote it; the file's own differs once resized."""

    @property
    def camera(self) -> tuple[str, str, str, float | None, float | None]:
        """Identity of a camera and its lens setting.

        Digital zoom changes the 35 mm equivalent only.
        """
        return self.make, self.model, self.lens, self.focal_mm, self.focal_35mm

    @property
    def names_camera(self) -> bool:
        """True if it says anything at all about the camera."""
        return any(self.camera)

    def focal_pixels(self, width: int, height: int) -> float | None:
        """Focal length in pixels of an image of this size; ``None`` where nothing says it.

        The image may have been resized, but not cropped: Exif does not tell that.

        Args:
            width: pixels of the image as it is now; upright or not does not matter.
            height: likewise.
        """
        longer = max(width, height)
        guesses = []
        if self.focal_35mm:
            guesses.append(self.focal_35mm / FILM_DIAGONAL * math.hypot(width, height))
        if self.focal_mm and self.pixels_per_mm:
            resized = longer / (self.longer_edge or longer)
            guesses.append(self.focal_mm * self.pixels_per_mm * resized)
        shortest, longest = PLAUSIBLE
        likely = (guess for guess in guesses if shortest * longer <= guess <= longest * longer)
        return next(likely, None)


def read_exif(path: Path) -> Exif:
    """Read the EXIF data of an image file; missing or damaged fields are empty."""
    with warnings.catch_warnings():
        # Pillow warns of damaged Exif, which is as good as none.
        warnings.simplefilter("ignore")
        try:
            with BoundedFile(path) as file, Image.open(file, formats=FORMATS) as image:
                # Pillow would decode a whole PNG to look for late Exif.
                if image.format == "PNG" and "exif" not in image.info:
                    return Exif()
                tags = image.getexif()
                return _read({**tags, **tags.get_ifd(IFD.Exif)})
        except Exception:  # Pillow raises whatever a broken file makes it.
            return Exif()


def _read(tags: Mapping[int, Any]) -> Exif:
    taken = _text(tags.get(Base.DateTimeOriginal))
    edges = (_number(tags.get(tag)) for tag in (Base.ExifImageWidth, Base.ExifImageHeight))
    longer_edge = max((edge for edge in edges if edge), default=None)
    return Exif(
        make=_text(tags.get(Base.Make)),
        model=_text(tags.get(Base.Model)),
        lens=_text(tags.get(Base.LensModel)),
        focal_mm=_number(tags.get(Base.FocalLength)),
        focal_35mm=_number(tags.get(Base.FocalLengthIn35mmFilm)),
        taken=taken if DATE.fullmatch(taken) else "",
        pixels_per_mm=_pixels_per_mm(tags),
        longer_edge=None if longer_edge is None else int(longer_edge),
    )


def _pixels_per_mm(tags: Mapping[int, Any]) -> float | None:
    pixels = _number(tags.get(Base.FocalPlaneXResolution))
    unit = MILLIMETRES.get(tags.get(Base.FocalPlaneResolutionUnit, INCH))
    return None if pixels is None or unit is None else pixels / unit


def _text(value: object) -> str:
    """The text without the padding to a fixed length; empty for other values."""
    return value.replace("\0", " ").strip() if isinstance(value, str) else ""


def _number(value: Any) -> float | None:  # noqa: ANN401 - Exif holds whatever it likes
    """``None`` unless it is positive and finite; 0 means unknown in Exif."""
    try:
        number = float(value)
    except (TypeError, ValueError, ArithmeticError):
        return None
    return number if math.isfinite(number) and number > 0 else None
