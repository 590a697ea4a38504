"""Texels: the images of SOG, as rows of four bytes; read within bounds."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from PIL import Image

from gsfw.core.errors import COPY_AGAIN, DataError

SIDE_STEP = 4
"""Sides of images are multiples of it, as those of splat-transform."""
MAX_SIDE = 16383
"""Longest side of a WebP."""
MAX_PADDING = 1 << 16
"""Texels without a splat that an image may have, beyond as many as it has splats; and bytes beyond
those of its texels."""
METHOD, EFFORT = 2, 75
"""Settings of the encoder, at most 6 and 100: 4 and 100 need ten times as long for 0.1 % less."""
UNREADABLE = (
    OSError,
    ValueError,
    SyntaxError,
    EOFError,
    struct.error,
    Image.DecompressionBombError,
)
"""Errors of Pillow on damaged images."""


def image_shape(count: int) -> tuple[int, int]:
    """Height and width of the images of ``count`` splats: nearly square.

    Raises:
        ValueError: there are more than an image holds.
    """
    width = _rounded_up(int(np.ceil(np.sqrt(count))))
    height = _rounded_up(-(-count // width))
    if width > MAX_SIDE:
        raise ValueError(f"{count} splats are more than its images hold ({MAX_SIDE**2})")
    return height, width


def _rounded_up(value: int) -> int:
    return -(-value // SIDE_STEP) * SIDE_STEP


def encode(texels: UInt8[np.ndarray, "n channels"], height: int, width: int) -> bytes:
    """A lossless WebP; missing channels are 0, missing alpha and padding are opaque."""
    image = np.zeros((height * width, 4), dtype=np.uint8)
    image[:, 3] = 255
    image[: len(texels), : texels.shape[1]] = texels
    buffer = io.BytesIO()
    # Exact: colours below an alpha of 0 are values too.
    Image.fromarray(image.reshape(height, width, 4)).save(
        buffer, "WEBP", lossless=True, exact=True, quality=EFFORT, method=METHOD
    )
    return buffer.getvalue()


def decode(
    path: Path, name: str, content: bytes, least: int, most: int
) -> UInt8[np.ndarray, "h w 4"]:
    """The texels of an image.

    Args:
        path: the file, for messages.
        name: name of the image, for messages.
        content: WebP or PNG.
        least: texels that it needs.
        most: texels above which nothing is decoded.

    Raises:
        DataError: it is damaged, of another size, or neither WebP nor PNG.
    """
    try:
        size = _webp_size(content) if content[:4] == b"RIFF" else _png_size(content)
    except UNREADABLE as error:
        raise DataError(f"{path}: its image {name} is damaged.", COPY_AGAIN) from error
    _check_size(path, name, size, least, most)
    try:
        with Image.open(io.BytesIO(content), formats=["WEBP", "PNG"]) as image:
            texels = np.asarray(image.convert("RGBA"))
    except UNREADABLE as error:
        raise DataError(f"{path}: its image {name} is damaged.", COPY_AGAIN) from error
    _check_size(path, name, (texels.shape[1], texels.shape[0]), least, most)
    return texels


def most_texels(count: int) -> int:
    """Texels that an image for ``count`` splats may have, padding included."""
    return 2 * count + MAX_PADDING


def most_bytes(texels: int) -> int:
    """Bytes that an image of so many texels may take: lossless compression may add a little."""
    return 5 * texels + MAX_PADDING


def _check_size(path: Path, name: str, size: tuple[int, int], least: int, most: int) -> None:
    """Refuse images that are too small, and those whose memory nothing justifies."""
    width, height = size
    if not least <= width * height <= most:
        raise DataError(
            f"{path}: its image {name} is {width} x {height}; {least} texels are described.",
            COPY_AGAIN,
        )


def _png_size(content: bytes) -> tuple[int, int]:
    """Width and height that a PNG announces."""
    with Image.open(io.BytesIO(content), formats=["PNG"]) as image:
        return image.size


def _webp_size(content: bytes) -> tuple[int, int]:
    """Width and height that a WebP announces: its decoder reserves them before it reads on.

    Raises:
        ValueError: it announces none.
    """
    kind, start = content[12:16], content[20:30]
    if content[8:12] != b"WEBP" or len(start) < 10:
        raise ValueError("no WebP")
    if kind == b"VP8X":
        sides = int.from_bytes(start[4:7], "little"), int.from_bytes(start[7:10], "little")
        return sides[0] + 1, sides[1] + 1
    if kind == b"VP8L" and start[0] == 0x2F:
        bits = int.from_bytes(start[1:5], "little")
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8 " and start[3:6] == b"\x9d\x01\x2a":
        sides = int.from_bytes(start[6:8], "little"), int.from_bytes(start[8:10], "little")
        return sides[0] & 0x3FFF, sides[1] & 0x3FFF
    raise ValueError("no WebP")
