"""Image files of a data set: bytes that are copied, or pixels that are encoded anew."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image
from PIL.ExifTags import IFD, Base

from gsfw.core.files.bounded_file import BoundedFile
from gsfw.datamanagers.images import FORMATS, Header, fit_image
from gsfw.datamanagers.warp import MapCache, Warp
from gsfw.preparation.writing.camera_plan import CameraPlan

FORMAT_OF_VIDEOS = "JPEG"
"""Output format of their images, which are lossy already."""
SRGB = 1
"""The colour space of EXIF (CIPA DC-008, tag 40961)."""
LONGEST_EXIF = 65_000
"""Bytes; a JPEG has room for 65,533."""


@dataclass(frozen=True)
class StoredImage:
    """Content and format of an image on disk."""

    path: Path
    format: str
    """As Pillow calls it, told by content; JPEG where further images follow, too."""
    is_turned: bool
    """True if only a tag says how it stands, which many tools do not read."""

    @staticmethod
    def read(path: Path, header: Header) -> StoredImage:
        """Look at the beginning of an image that has a header."""
        with BoundedFile(path) as file, Image.open(file, formats=FORMATS) as image:
            # Pillow turns TIFF upright by itself.
            tag = image.getexif().get(Base.Orientation, 1) if image.format == "TIFF" else 1
            turned = header.orientation != 1 or tag in range(2, 9)
            return StoredImage(path, "JPEG" if image.format == "MPO" else str(image.format), turned)

    @property
    def rewritten_format(self) -> str:
        """Output format where its pixels change."""
        return "JPEG" if self.format == "JPEG" else "PNG"

    def rewritten(self, pixels: UInt8[np.ndarray, "h w d"], quality: int) -> bytes:
        """A file of other pixels, with the EXIF of this one.

        The orientation is left out, as pixels are upright, and the profile, as colours are sRGB.
        """
        with BoundedFile(self.path) as file, Image.open(file, formats=FORMATS) as image:
            exif = exif_of(image)
        return encoded(pixels, self.rewritten_format, quality, exif)


@dataclass(frozen=True)
class ImageChange:
    """The change from an input image to an output image."""

    stored: StoredImage | None
    """``None`` for an image of a video."""
    plan: CameraPlan

    @property
    def is_copied(self) -> bool:
        """True if the file stays as it is, byte for byte."""
        is_moved = self.plan.undistortion is not None
        return self.stored is not None and not self.stored.is_turned and not is_moved

    @property
    def format(self) -> str:
        """Format of the written file."""
        if self.stored is None:
            return FORMAT_OF_VIDEOS
        return self.stored.format if self.is_copied else self.stored.rewritten_format

    def warp(self, maps: MapCache) -> Warp | None:
        """The undistorting warp; ``None`` where the pixels stay as they are."""
        undistortion = self.plan.undistortion
        return None if undistortion is None else Warp(undistortion, maps)

    def content(
        self, decode: Callable[[], UInt8[np.ndarray, "h w d"]], warp: Warp | None, quality: int
    ) -> bytes:
        """The written file.

        Args:
            decode: gives the upright image; only called where the file does not stay.
            warp: as ``warp`` gives it.
            quality: of a JPEG.
        """
        if self.stored is not None and self.is_copied:
            return self.stored.path.read_bytes()
        shown = fit_image(decode(), None, self.plan.target.width, self.plan.target.height, warp)
        if self.stored is None:
            return encoded(shown.pixels, FORMAT_OF_VIDEOS, quality)
        return self.stored.rewritten(shown.pixels, quality)


def encoded_mask(mask: Bool[np.ndarray, "h w"]) -> bytes:
    """A mask as the bytes of a PNG: white where it is true."""
    return encoded(np.where(mask, 255, 0).astype(np.uint8)[..., None], "PNG", 0)


def encoded(
    pixels: UInt8[np.ndarray, "h w d"], format_name: str, quality: int, exif: bytes = b""
) -> bytes:
    """An image as the bytes of a JPEG (without subsampled colours) or PNG.

    Args:
        pixels: grey (d = 1), RGB or RGBA.
        format_name: JPEG or PNG.
        quality: of a JPEG, up to 100.
        exif: as Pillow writes it.
    """
    # PNG's usual effort (6) takes five times as long, for files that are 8 % smaller.
    settings = (
        {"quality": quality, "subsampling": 0} if format_name == "JPEG" else {"compress_level": 3}
    )
    buffer = io.BytesIO()
    flat = pixels[..., 0] if pixels.shape[2] == 1 else pixels
    Image.fromarray(flat).save(buffer, format_name, exif=exif, **settings)
    return buffer.getvalue()


def exif_of(image: Image.Image) -> bytes:
    """EXIF data of an image as upright sRGB; empty where it cannot be read."""
    try:
        exif = image.getexif()
        # Those of a TIFF tell where in the file its pixels are.
        if not exif or image.format == "TIFF":
            return b""
        exif.pop(Base.Orientation, None)
        details = exif.get_ifd(IFD.Exif)
        details.pop(IFD.Interop, None)  # DCF notes Adobe RGB there.
        if Base.ColorSpace in details:
            details[Base.ColorSpace] = SRGB
        content = exif.tobytes()
    except Exception:  # Pillow raises whatever a broken tag makes it.
        return b""
    return content if len(content) <= LONGEST_EXIF else b""


@dataclass(frozen=True)
class OutputRule:
    """The user's choices."""

    lens: Literal["pinhole", "keep"] = "pinhole"
    """Images are undistorted to PINHOLE, or lenses and files stay."""
    jpeg_quality: int = 95
    """Quality of JPEG files that are encoded anew."""
