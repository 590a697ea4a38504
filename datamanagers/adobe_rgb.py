"""Adobe RGB: its colour profile, for photos that only name the space in their EXIF data.

Primaries and exponent are those of the Adobe RGB (1998) Color Image Encoding (section 4.3), and the
form of the profile is ICC.1:2001-04.
"""

from __future__ import annotations

import struct

from PIL import Image
from PIL.ExifTags import IFD, Base, Interop

RED, GREEN, BLUE = (
    (0.60974, 0.20528, 0.14919),
    (0.31111, 0.62567, 0.06322),
    (0.01947, 0.06087, 0.74457),
)
"""X, Y and Z of red, green and blue, by rows, adapted to D50."""
D50 = (0.9642, 1.0, 0.8249)
EXPONENT = 563
"""The exponent 2.19921875 in parts of 256."""
UNCALIBRATED, ADOBE = 65535, 2
"""Values of the EXIF colour space: not sRGB, and the one that some programs write for Adobe RGB."""
OPTION_FILE = "R03"
"""Index of the DCF option files, which have the colours of Adobe RGB (CIPA DC-009)."""


def is_adobe_rgb(image: Image.Image) -> bool:
    """True if the EXIF data of an image, which has no profile, names Adobe RGB."""
    try:
        # Pillow would decode a whole PNG to look for late EXIF.
        if "exif" not in image.info and image.format != "TIFF":
            return False
        exif = image.getexif()
        space = exif.get_ifd(IFD.Exif).get(Base.ColorSpace)
        index = exif.get_ifd(IFD.Interop).get(Interop.InteropIndex, "")
    except Exception:  # Pillow raises whatever a broken tag makes it.
        return False
    return space == ADOBE or (space == UNCALIBRATED and str(index).strip("\0 ") == OPTION_FILE)


def adobe_rgb() -> bytes:
    """The ICC profile of Adobe RGB."""
    curve = b"curv" + bytes(4) + struct.pack(">IH", 1, EXPONENT) + bytes(2)
    tags = {
        b"desc": b"desc" + bytes(4) + struct.pack(">I", 10) + b"Adobe RGB\0" + bytes(78),
        b"wtpt": _xyz(*D50),
    }
    for letter, place in zip("rgb", zip(RED, GREEN, BLUE, strict=True), strict=True):
        tags[f"{letter}XYZ".encode()] = _xyz(*place)
        tags[f"{letter}TRC".encode()] = curve
    start = 128 + 4 + 12 * len(tags)
    table, content = struct.pack(">I", len(tags)), b""
    for name, data in tags.items():
        table += struct.pack(">4sII", name, start + len(content), len(data))
        content += data + bytes(-len(data) % 4)
    size = start + len(content)
    header = struct.pack(">I4xI4s4s4s", size, 0x02400000, b"mntr", b"RGB ", b"XYZ ")
    header += struct.pack(">6H4s28x", 2026, 1, 1, 0, 0, 0, b"acsp") + _xyz(*D50)[8:]
    return header.ljust(128, b"\0") + table + content


def _xyz(x: float, y: float, z: float) -> bytes:
    return struct.pack(">4s4x3i", b"XYZ ", *(round(65536 * value) for value in (x, y, z)))
