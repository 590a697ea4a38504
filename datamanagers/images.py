"""DecodedImage files: headers, decoding to upright 8-bit colours, masks.

Policy on EXIF orientation: it is always applied. Cameras that describe the image as stored are
turned with it (``upright``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, Num, UInt8
from PIL import Image, UnidentifiedImageError
from PIL.ExifTags import Base

from gsfw.core.errors import DataError
from gsfw.core.files.bounded_file import BoundedFile
from gsfw.core.files.mirror import held
from gsfw.core.files.reading import check_downloaded
from gsfw.datamanagers.area import (
    STRIP,
    shrink,
    shrink_in_strips,
    shrink_into,
    shrink_mask,
    shrink_values,
    to_values,
)
from gsfw.datamanagers.color_profile import in_srgb, profile_of, unconverted
from gsfw.datamanagers.fitted_map import FittedMap
from gsfw.datamanagers.warp import Warp

EXTENSIONS = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp")
"""Extensions of image files, in the order of their trial if a path has none."""

FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "BMP")
"""Formats that Pillow may read; recognised by content, not by extension."""
MASK_EXTENSIONS = (*EXTENSIONS, ".gif", ".pgm", ".pbm", ".tga", ".jp2")
"""Extensions of mask files: segmentation tools write more formats than cameras."""
MASK_FORMATS = (*FORMATS, "GIF", "PPM", "TGA", "JPEG2000")
"""Formats of masks."""
PIXELS_PER_BYTE = {"PNG": 8256, "JPEG": 4096, "BMP": 2048}
"""Most pixels that a byte of a file can hold: 1,032 bytes of Deflate with a bit for each pixel, two
bits for each block of 16 x 16 pixels, runs of 255 pixels in two bytes with room to spare. Formats
that are left out can hold an image of one colour in a few bytes."""
UPRIGHT = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
"""Operation that turns an image of each EXIF orientation upright (CIPA DC-008, tag 274)."""
LAST_ROW_FIRST = (3, 4, 6, 7)
"""Orientations whose last stored row is the first row or column of the upright image."""


@dataclass(frozen=True)
class Header:
    """Facts on an image that need no decoding."""

    width: int
    """Pixels of the upright image."""
    height: int
    """Pixels of the upright image."""
    has_alpha: bool
    """True if the file has transparency."""
    orientation: int = 1
    """The EXIF orientation that was applied; 1 when there is none."""
    unconverted: str = ""
    """The colour space, where it is not sRGB and is not converted; empty otherwise."""

    def __str__(self) -> str:
        size = f"{self.width}x{self.height} pixels"
        return size if self.orientation == 1 else f"{size} (EXIF orientation {self.orientation})"


@dataclass(frozen=True)
class DecodedImage:
    """A decoded image."""

    pixels: UInt8[np.ndarray, "h w d"]
    """Red, green, blue, and alpha where the file has it (d = 3 or 4); straight colours."""
    mask: Bool[np.ndarray, "h w"] | None = None
    """True where a pixel is valid; ``None`` when all are."""
    maps: Mapping[str, FittedMap] = field(default_factory=dict)
    """Per-view maps by name, undistorted."""


def read_header(path: Path) -> Header:
    """Look at the beginning of an image file.

    Raises:
        DataError: it is no image that can be decoded.
    """
    with _opened(path, whole=False) as image:
        if image.mode == "F":
            raise DataError(
                f"{path}: the pixels are floating-point numbers.",
                "Expected 8 or 16 bits per channel; convert the image to PNG.",
            )
        _refuse_planar_16_bit(path, image)
        orientation = _orientation(image)
        width, height = image.size if orientation < 5 else image.size[::-1]
        has_alpha = image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info
        return Header(width, height, has_alpha, orientation, unconverted(image))


def fit_image(
    pixels: UInt8[np.ndarray, "h w d"],
    valid: Bool[np.ndarray, "h w"] | None,
    width: int,
    height: int,
    warp: Warp | None = None,
) -> DecodedImage:
    """A decoded image, undistorted and shrunk; rounded to 8 bits once."""
    fitted = fit_mask(valid, width, height, warp)
    if warp is None:
        return DecodedImage(shrink(pixels, width, height), fitted)
    # Numbers of one channel at a time take less memory; those with alpha belong together.
    channels = pixels.shape[2]
    groups = [slice(0, 4)] if channels == 4 else [slice(one, one + 1) for one in range(channels)]
    target, small = warp.undistortion.target, np.empty((height, width, channels), np.uint8)
    for group in groups:
        rows = partial(warp.colors, to_values(pixels[..., group]))
        shrink_into(small[..., group], rows, (target.height, target.width))
    return DecodedImage(small, fitted)


def fit_small(
    pixels: UInt8[np.ndarray, "h w d"],
    valid: Bool[np.ndarray, "h w"] | None,
    width: int,
    height: int,
    warp: Warp | None = None,
) -> tuple[Float32[np.ndarray, "h2 w2 d"], Bool[np.ndarray, "h2 w2"] | None]:
    """An undistorted and shrunk image with few floating-point numbers at a time, and its mask.

    Colours are in [0, 255], multiplied by alpha where there is one, and not rounded. A lens is
    undone at twice the final size, by linear interpolation.
    """
    if warp is None:
        return shrink_in_strips(pixels, width, height), fit_mask(valid, width, height)
    source, target = warp.undistortion.source, warp.undistortion.target
    rows, columns = min(pixels.shape[0], 2 * height), min(pixels.shape[1], 2 * width)
    values = shrink_in_strips(pixels, columns, rows)
    known = np.ones((rows, columns), bool) if valid is None else shrink_mask(valid, columns, rows)
    layers = np.concatenate([values, known[..., None].astype(np.float32)], axis=2)
    wide = max(width, round(target.width * columns / source.width))
    high = max(height, round(target.height * rows / source.height))
    straight = shrink_values(warp.numbers(layers, wide, high, "bilinear"), width, height)
    blank = warp.mask(None)
    mask = straight[..., -1] > 1 - 1e-4
    if blank is not None:
        mask &= shrink_mask(blank, width, height)
    return straight[..., :-1], None if mask.all() else mask


def fit_mask(
    valid: Bool[np.ndarray, "h w"] | None, width: int, height: int, warp: Warp | None = None
) -> Bool[np.ndarray, "h2 w2"] | None:
    """The mask of a fitted image; ``None`` when all of its pixels are valid."""
    if warp is not None:
        valid = warp.mask(valid)
    return None if valid is None else shrink_mask(valid, width, height)


def load_mask(mask: Path, path: Path, header: Header) -> Bool[np.ndarray, "h w"]:
    """Decode the mask of the image at ``path``.

    Raises:
        DataError: it does not decode, or its size is not the image's.
    """
    bright = decode_mask(mask)
    if bright.shape != (header.height, header.width):
        raise DataError(
            f"{mask}: the mask is {bright.shape[1]}x{bright.shape[0]} pixels, "
            f"its image {path} is {header.width}x{header.height}.",
            "A mask needs the size of its (upright) image.",
        )
    return bright


def decode(
    path: Path, header: Header, least: tuple[int, int] | None = None, as_stored: bool = False
) -> UInt8[np.ndarray, "h w d"]:
    """The upright image as 8-bit RGB, or RGBA where its header says that it has alpha.

    16-bit colours keep their upper 8 bits; grey, palette and CMYK are converted, and colours of an
    embedded profile, or of Adobe RGB by EXIF, become sRGB.

    Args:
        path: of the file.
        header: of the image.
        least: width and height that are enough. JPEG decodes to a half, a quarter or an eighth at
            a fraction of the time and memory; other formats have all of their pixels.
        as_stored: take the numbers of the file for sRGB, whatever its profile says.

    Raises:
        DataError: it does not decode.
    """
    with _opened(path) as image:
        if least is not None:
            image.draft(None, least if header.orientation < 5 else least[::-1])
        image.load()
        height, width = image.height, image.width
        turned = header.orientation >= 5
        profile = None if as_stored else profile_of(image)
        pixels = np.empty(
            (*((width, height) if turned else (height, width)), 4 if header.has_alpha else 3),
            np.uint8,
        )
        # Pillow's copies of a whole image take four bytes of each pixel.
        for top in range(0, height, STRIP):
            bottom = min(top + STRIP, height)
            strip = image.crop((0, top, width, bottom))
            rows = slice(top, bottom)
            if header.orientation in LAST_ROW_FIRST:
                rows = slice(height - bottom, height - top)
            pixels[(slice(None), rows) if turned else rows] = _colors(
                _turned(strip, header.orientation), "RGBA" if header.has_alpha else "RGB", profile
            )
        return pixels


def _colors(image: Image.Image, mode: str, profile: bytes | None) -> UInt8[np.ndarray, "h w d"]:
    if not image.mode.startswith("I"):
        return np.asarray(in_srgb(image, mode, profile))
    values = np.asarray(image)
    grey = Image.fromarray((values.clip(0, 65535).astype(np.uint16) >> 8).astype(np.uint8))
    colors = np.asarray(in_srgb(grey, "RGB", profile))
    if mode == "RGB":
        return colors
    alpha = np.where(values == image.info["transparency"], 0, 255)  # One value of a PNG.
    return np.concatenate([colors, alpha[..., None].astype(np.uint8)], axis=2)


def decode_mask(path: Path) -> Bool[np.ndarray, "h w"]:
    """True where a mask is bright; black and white may be 0 and 255, or 0 and 1.

    Raises:
        DataError: it does not decode.
    """
    with _opened(path, MASK_FORMATS) as image:
        values = np.asarray(_upright(image).convert("L"))
        return values > values.max() // 2


NUMBERS = {"1": 1, "L": 1, "I": 1, "I;16": 1, "I;16B": 1, "F": 1, "P": 1, "LA": 2, "RGB": 3}
NUMBERS |= {"RGBA": 4}
"""Pillow's modes whose pixels are read as numbers, and how many each pixel has."""


def numbers_header(path: Path) -> tuple[tuple[int, int, int], np.dtype[np.generic]]:
    """Height, width and channels of the upright image, and its type: see ``decode_numbers``.

    Raises:
        DataError: it is no image that can be decoded to numbers.
    """
    with _opened(path, whole=False) as image:
        _refuse_planar_16_bit(path, image)
        if image.mode not in NUMBERS:
            raise DataError(
                f"{path}: pixels of the mode {image.mode} are no plain numbers.",
                "Convert the image to grey or RGB, or to .npy.",
            )
        width, height = image.size if _orientation(image) < 5 else image.size[::-1]
        bits = {"F": np.float32}.get(image.mode, np.uint16 if image.mode[0] == "I" else np.uint8)
        return (height, width, NUMBERS[image.mode]), np.dtype(bits)


def decode_numbers(path: Path) -> Num[np.ndarray, "h w d"]:
    """The upright image's numbers as they are stored, of 1, 8, 16 or 32 bits.

    A palette's numbers are its indices; of 16-bit RGB only the upper 8 bits are read.

    Raises:
        DataError: it does not decode.
    """
    with _opened(path) as image:
        values = np.asarray(_upright(image))
    if values.dtype == bool:
        values = values.astype(np.uint8)
    return values if values.ndim == 3 else values[..., None]


@contextmanager
def _opened(
    path: Path, formats: tuple[str, ...] = FORMATS, whole: bool = True
) -> Iterator[Image.Image]:
    try:
        with (
            held(path, whole),
            BoundedFile(path) as file,
            Image.open(file, formats=formats) as image,
        ):
            if whole:
                _check_size(path, image)
            yield image
    except DataError:
        raise
    except Exception as error:  # Pillow's decoders raise whatever a broken file makes them.
        check_downloaded(path)
        raise DataError(
            f"{path}: {_reason(path, error)}",
            "Replace the file, or remove it: images that are missing are left out.",
        ) from error


def _check_size(path: Path, image: Image.Image) -> None:
    """Check that a file is large enough for its pixels, before there is memory for them.

    Raises:
        ValueError: it is not.
    """
    most = PIXELS_PER_BYTE.get(image.format or "")
    held_bytes = path.stat().st_size
    if most is not None and image.width * image.height > most * held_bytes:
        raise ValueError(
            f"its header announces {image.width}x{image.height} pixels, which {held_bytes} bytes "
            "cannot hold"
        )


def _reason(path: Path, error: Exception) -> str:
    if not path.exists():
        return "there is no such file."
    size = path.stat().st_size
    if size == 0:
        return "the file is empty (0 bytes)."
    if isinstance(error, UnidentifiedImageError):
        return f"these {size} bytes are no {', '.join(FORMATS)} image."
    if isinstance(error, OSError) and error.strerror:
        return f"the file cannot be read: {error.strerror}."
    return f"the image does not decode: {error}"


def _refuse_planar_16_bit(path: Path, image: Image.Image) -> None:
    """Refuse a TIFF that Pillow would read as 8-bit channels, which gives another image."""
    tags = getattr(image, "tag_v2", {})
    bits = tags.get(258, (1,))  # BitsPerSample; 284: PlanarConfiguration (TIFF 6.0).
    if image.format == "TIFF" and tags.get(284) == 2 and len(bits) > 1 and max(bits) > 8:
        raise DataError(
            f"{path}: the TIFF holds each of its 16-bit channels apart (planar), which Pillow does "
            "not read correctly.",
            "Store its channels together (tiffcp -p contig IN.tif OUT.tif), or convert it to PNG.",
        )


def _orientation(image: Image.Image) -> int:
    # Pillow turns TIFF upright itself, and would decode a whole PNG to look for late EXIF.
    if image.format == "TIFF" or (image.format == "PNG" and "exif" not in image.info):
        return 1
    orientation = image.getexif().get(Base.Orientation, 1)
    return orientation if orientation in UPRIGHT else 1


def _upright(image: Image.Image) -> Image.Image:
    return _turned(image, _orientation(image))


def _turned(image: Image.Image, orientation: int) -> Image.Image:
    return image if orientation == 1 else image.transpose(UPRIGHT[orientation])
