"""Names and numbers of glTF 2.0 and of the extension, and the container of .glb files."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

GLB_HEADER = struct.Struct("<4sII")
"""Magic, version, bytes of the file."""
CHUNK = struct.Struct("<I4s")
"""Bytes and kind of a chunk."""
MAGIC, JSON_CHUNK, BINARY_CHUNK = b"glTF", b"JSON", b"BIN\0"

COMPONENTS: dict[int, np.dtype[Any]] = {
    5120: np.dtype("i1"),
    5121: np.dtype("u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5126: np.dtype("<f4"),
}
"""Types of the numbers of attributes."""
UNSIGNED_BYTE, UNSIGNED_INT, FLOAT = 5121, 5125, 5126
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
POINTS = 0
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963

EXTENSION = "KHR_gaussian_splatting"
ROTATION, SCALE, OPACITY = (f"{EXTENSION}:{name}" for name in ("ROTATION", "SCALE", "OPACITY"))
DRAFT_ROTATION, DRAFT_SCALE = "_ROTATION", "_SCALE"
"""Names in the first drafts of the extension (2024), where COLOR_0 has the colours as shown and the
opacities; CesiumJS has a file (Specs/Data/Cesium3DTiles/GaussianSplats/synthetic)."""
COLOR_SPACE = "srgb_rec709_display"
"""Colours as 3DGS trains them: those of a screen."""
MOST_DEGREE = 3


def coefficient(index: int) -> str:
    """The attribute of an SH coefficient, in the order of the bands."""
    degree = int(index**0.5)
    return f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{index - degree * degree}"


def padded_text(text: str) -> bytes:
    """JSON with blanks up to a multiple of 4 bytes, which the format asks for."""
    content = text.encode()
    return content + b" " * (-len(content) % 4)


def glb_size(text: bytes, binary: int) -> int:
    """Bytes of a file with this padded JSON and so many bytes of binary data."""
    return GLB_HEADER.size + 2 * CHUNK.size + len(text) + binary


def glb_start(text: bytes, binary: int) -> bytes:
    """All of a file before its binary data; it holds at most 2^32 - 1 bytes."""
    header = GLB_HEADER.pack(MAGIC, 2, glb_size(text, binary))
    return header + CHUNK.pack(len(text), JSON_CHUNK) + text + CHUNK.pack(binary, BINARY_CHUNK)
