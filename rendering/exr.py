"""EXR: float images of any channels in one file, as OpenEXR 2 lays them out.

One part of scan lines, compressed without loss (ZIP: 16 lines at a time). Academy Software
Foundation, "OpenEXR File Layout" (https://openexr.com/en/latest/OpenEXRFileLayout.html).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float32, UInt8

MAGIC, VERSION = 20000630, 2
FLOAT, ZIP, INCREASING_Y = 2, 3, 0
"""Codes of the pixel type, of the compression, and of the order of the lines."""
LINES = 16
"""Lines of a block of ZIP."""
LEVEL = 4
"""Effort of zlib: higher ones take several times as long for a few percent."""


def exr_bytes(channels: Mapping[str, Float32[np.ndarray, "h w"]]) -> bytes:
    """A file of named channels, such as R, G, B, A and Z, of one size.

    Raises:
        ValueError: there is none, or their sizes differ.
    """
    names = sorted(channels)
    if len({channels[name].shape for name in names}) != 1:
        raise ValueError("an EXR needs at least one channel, and all of one size")
    # Within a line the channels follow one another, in the order of their names.
    lines = np.stack([channels[name] for name in names], axis=1).astype("<f4")
    height, _, width = lines.shape
    header = _header(names, width, height)
    blocks = [
        _block(first, lines[first : first + LINES].tobytes()) for first in range(0, height, LINES)
    ]
    place, offsets = len(header) + 8 * len(blocks), []
    for block in blocks:
        offsets.append(place)
        place += len(block)
    return b"".join([header, struct.pack(f"<{len(offsets)}Q", *offsets), *blocks])


def _header(names: list[str], width: int, height: int) -> bytes:
    listed = b"".join(
        name.encode() + b"\0" + struct.pack("<iBxxxii", FLOAT, 0, 1, 1) for name in names
    )
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    attributes = (
        ("channels", "chlist", listed + b"\0"),
        ("compression", "compression", bytes([ZIP])),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", bytes([INCREASING_Y])),
        ("pixelAspectRatio", "float", struct.pack("<f", 1)),
        ("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1)),
    )
    written = b"".join(
        f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value
        for name, kind, value in attributes
    )
    return struct.pack("<2i", MAGIC, VERSION) + written + b"\0"


def _block(first_line: int, raw: bytes) -> bytes:
    """One block: its first line, its length, its data; as it is where zlib gains nothing."""
    packed = zlib.compress(_predicted(np.frombuffer(raw, np.uint8)).tobytes(), LEVEL)
    data = packed if len(packed) < len(raw) else raw
    return struct.pack("<2i", first_line, len(data)) + data


def _predicted(data: UInt8[np.ndarray, " n"]) -> UInt8[np.ndarray, " n"]:
    """Bytes at even places, then those at odd ones, each as the difference to the one before."""
    apart = np.concatenate([data[0::2], data[1::2]])
    steps = apart.copy()
    steps[1:] = apart[1:] - apart[:-1] + np.uint8(128)
    return steps
