"""Colour profiles of RGB by their primaries, and the conversion of their colours in float64."""

import struct

import numpy as np

DISPLAY_P3 = (
    (0.51512, 0.24120, -0.00105),
    (0.29198, 0.69225, 0.04189),
    (0.15710, 0.06657, 0.78407),
)
ADOBE_RGB = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))
SRGB = ((0.43607, 0.22249, 0.01392), (0.38515, 0.71687, 0.09708), (0.14307, 0.06061, 0.71410))
"""XYZ of red, green and blue, adapted to D50."""
WHITE = (0.9642, 1.0, 0.8249)
GAMMA = 2.2


def profile(primaries, space=b"RGB ") -> bytes:
    """An ICC profile of version 2.1 (ICC.1:1998-09): primaries, and one exponent."""
    tags = {}
    for letter, place in zip("rgb", primaries, strict=True):
        tags[f"{letter}XYZ".encode()] = _xyz(place)
        tags[f"{letter}TRC".encode()] = _curve(GAMMA)
    return _assembled(tags, space)


def grey_profile(gamma) -> bytes:
    """A profile of grey with one exponent."""
    return _assembled({b"kTRC": _curve(gamma)}, b"GRAY")


def ink_profile() -> bytes:
    """A profile of CMYK whose 16 corners are white, or a grey of L* = 40 with any ink."""
    corners = bytes(
        255 if ink == 0 and channel == 0 else 102 if channel == 0 else 128
        for ink in range(16)
        for channel in range(3)
    )
    ramp = bytes(range(256))
    identity = struct.pack(
        ">9i", *(65536 * (row == column) for row in range(3) for column in range(3))
    )
    table = b"mft1" + bytes(4) + struct.pack(">4B", 4, 3, 2, 0) + identity
    return _assembled({b"A2B0": table + 4 * ramp + corners + 3 * ramp}, b"CMYK", b"prtr", b"Lab ")


def _curve(gamma) -> bytes:
    return b"curv" + bytes(4) + struct.pack(">IH", 1, round(gamma * 256)) + bytes(2)


def _assembled(own_tags, space, kind=b"mntr", connection=b"XYZ ") -> bytes:
    tags = {
        b"wtpt": _xyz(WHITE),
        b"desc": b"desc" + bytes(4) + struct.pack(">I", 2) + b"a\0" + bytes(78),
        **own_tags,
    }
    place = 128 + 4 + 12 * len(tags)
    table, content = struct.pack(">I", len(tags)), b""
    for name, data in tags.items():
        table += struct.pack(">4sII", name, place + len(content), len(data))
        content += data + bytes(-len(data) % 4)
    size = place + len(content)
    header = struct.pack(">I4sI4s4s4s", size, bytes(4), 0x02100000, kind, space, connection)
    header += struct.pack(">6H4s", 2026, 1, 1, 0, 0, 0, b"acsp") + bytes(28)
    header += b"".join(struct.pack(">i", round(value * 65536)) for value in WHITE)
    return header.ljust(128, b"\0") + table + content


def srgb_of(colors, primaries) -> np.ndarray:
    """Numbers in [0, 255] of a profile as those of sRGB (IEC 61966-2-1), clipped."""
    linear = (np.asarray(colors) / 255) ** GAMMA @ np.asarray(primaries) @ np.linalg.inv(SRGB)
    linear = linear.clip(0, 1)
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def _xyz(place) -> bytes:
    return b"XYZ " + bytes(4) + b"".join(struct.pack(">i", round(65536 * v)) for v in place)
