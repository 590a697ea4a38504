"""Image files: pictures as PNG of 8 or 16 bits or JPEG, values as EXR; each whole or not at all."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from gsfw.core.files.atomic import write_atomically
from gsfw.rendering.exr import exr_bytes

if TYPE_CHECKING:
    from jaxtyping import Float, UInt16
    from torch import Tensor

    from gsfw.rendering.channels import Channel

ImageFormat = Literal["png", "png16", "jpg", "exr"]

SUFFIXES: Mapping[ImageFormat, str] = {
    "png": ".png", "png16": ".png", "jpg": ".jpg", "exr": ".exr",
}  # fmt: skip

JPEG_QUALITY = 95
"""Quality on Pillow's scale; at 95 and without subsampling of colours the loss is hard to see."""

EXR_NAMES: Mapping[str, Sequence[str]] = {
    "color": ("R", "G", "B"),
    "alpha": ("A",),
    "depth": ("Z",),
    "photo": ("photo.R", "photo.G", "photo.B"),
    "normals": ("normals.X", "normals.Y", "normals.Z"),
}
"""Names in an EXR, as other tools expect them; any other channel has its own name."""


def write_image(path: Path, image: Float[Tensor, "h w 3"], kind: ImageFormat = "png") -> Path:
    """Write a picture of colours in [0, 1]; the path.

    Args:
        path: with the suffix of its format.
        image: colours; others are clamped.
        kind: png, png16 or jpg.

    Raises:
        OutputError: it cannot be written.
    """
    from PIL import Image

    values = image.clamp(0, 1).cpu().double().numpy()
    if kind == "png16":
        write_atomically(path, _png16((values * 65535).round().astype(np.uint16)))
        return path
    buffer, picture = io.BytesIO(), Image.fromarray((values * 255).round().astype(np.uint8))
    if kind == "jpg":
        picture.save(buffer, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    else:
        picture.save(buffer, "PNG")
    write_atomically(path, buffer.getvalue())
    return path


def write_values(path: Path, channels: Sequence[Channel], images: Sequence[Tensor]) -> Path:
    """Write rendered channels, as they are, into one EXR; the path.

    Normals are unit vectors: x to the right, y up, z to the camera; 0 where there is none.

    Args:
        path: of the file.
        channels: what the images are.
        images: as ``render_channels`` returns them.

    Raises:
        OutputError: it cannot be written.
    """
    named: dict[str, np.ndarray] = {}
    for channel, image in zip(channels, images, strict=True):
        values = image.float().cpu()
        if channel.name == "normals":
            values = (2 * values - 1) * (values.sum(2, keepdim=True) > 0)
        planes = [values] if values.ndim == 2 else list(values.unbind(2))
        names = EXR_NAMES.get(channel.name, (channel.name,))
        named |= {name: plane.numpy() for name, plane in zip(names, planes, strict=True)}
    write_atomically(path, exr_bytes(named))
    return path


def _png16(values: UInt16[np.ndarray, "h w 3"]) -> bytes:
    """A PNG of 16 bits per colour, which Pillow cannot write (W3C PNG, third edition)."""
    height, width, _ = values.shape
    lines = values.astype(">u2").reshape(height, -1).view(np.uint8)
    up = lines.copy()
    up[1:] -= lines[:-1]
    # Each line begins with its filter: 2 stores differences to the line above.
    filtered = np.concatenate([np.full((height, 1), 2, np.uint8), up], axis=1)
    return b"".join(
        [
            b"\x89PNG\r\n\x1a\n",
            _chunk(b"IHDR", struct.pack(">2I5B", width, height, 16, 2, 0, 0, 0)),
            _chunk(b"IDAT", zlib.compress(filtered.tobytes(), 6)),
            _chunk(b"IEND", b""),
        ]
    )


def _chunk(name: bytes, content: bytes) -> bytes:
    checked = name + content
    return struct.pack(">I", len(content)) + checked + struct.pack(">I", zlib.crc32(checked))
