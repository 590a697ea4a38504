"""Coded colours: numbers of videos and HEIC photos by ITU-T H.273, and their conversion to sRGB.

Phones record HLG, a curve of high dynamic range (HDR), by default. Its numbers look pale when they
are taken for sRGB. The conversion is the same for all images, as a curve that adapts to each would
give one surface several colours:

1. Light (ITU-R BT.2100-2, tables 4 and 5), for HLG of a display of 1000 nits.
2. The primaries of sRGB. Colours outside of them are clipped.
3. The range of sRGB. Its white is the reference white, 203 nits (ITU-R BT.2408). Shadows and middle
   tones keep their light, and highlights up to 1000 nits are compressed (ITU-R BT.2390, 5.4.1). The
   curve maps the largest of red, green and blue, and the others in proportion, which keeps the hue.
4. The numbers of sRGB (IEC 61966-2-1).

Curves without high dynamic range are taken for that of sRGB, so that only primaries change.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float32, Float64, UInt8, UInt16

PQ, HLG = 16, 18
"""Transfer characteristics of HDR (ITU-T H.273, table 3)."""
HDR = {PQ: "PQ", HLG: "HLG"}
"""Their names."""
PEAK = 1000.0
"""Nits from which highlights are clipped."""
WHITE = 203.0
"""Nits of the white of sRGB."""
SRGB, BT2020, P3 = 1, 9, 12
"""Primaries (ITU-T H.273, table 2)."""
PRIMARIES = {
    SRGB: ((0.64, 0.33), (0.3, 0.6), (0.15, 0.06)),
    BT2020: ((0.708, 0.292), (0.17, 0.797), (0.131, 0.046)),
    P3: ((0.68, 0.32), (0.265, 0.69), (0.15, 0.06)),
}
"""Chromaticities x, y of red, green and blue, of a white of D65."""
D65 = (0.3127, 0.329)
STRIP = 16
"""Rows that are converted at once: they stay in the processor's cache."""
LEVELS = np.linspace(0, 1, 1 << 16)
"""Numbers of 16 bits, in [0, 1]."""


def is_like_srgb(transfer: int, primaries: int) -> bool:
    """True if numbers of these characteristics (ITU-T H.273) are taken for sRGB as they are."""
    return transfer not in HDR and primaries not in (BT2020, P3)


def coded_to_srgb(
    pixels: UInt16[np.ndarray, "h w 3"], transfer: int, primaries: int
) -> UInt8[np.ndarray, "h w 3"]:
    """Convert an image to sRGB.

    Args:
        pixels: non-linear red, green and blue; 65535 for 1.
        transfer: ``PQ`` or ``HLG``; others are taken for the curve of sRGB.
        primaries: one of ``PRIMARIES``; others are taken for BT.2020 in HDR.
    """
    to_xyz = _to_xyz(primaries if primaries in PRIMARIES else BT2020)
    to_srgb = np.linalg.solve(_to_xyz(SRGB), to_xyz).astype(np.float32)
    luminance = to_xyz[1].astype(np.float32)
    result = np.empty(pixels.shape, np.uint8)
    for top in range(0, len(pixels), STRIP):
        light = _light(transfer)[pixels[top : top + STRIP]]
        if transfer == HLG:
            light *= _surround()[_level(light @ luminance)][..., None]
        light = light @ to_srgb.T
        if transfer in HDR:
            light *= _compression()[_level(light.max(axis=2))][..., None]
        result[top : top + STRIP] = _srgb()[_level(light)]
    return result


def _level(values: Float32[np.ndarray, "*b"]) -> UInt16[np.ndarray, "*b"]:
    """The nearest of ``LEVELS``."""
    return (values.clip(0, 1) * np.float32(len(LEVELS) - 1) + np.float32(0.5)).astype(np.uint16)


def _to_xyz(primaries: int) -> Float64[np.ndarray, "3 3"]:
    """The matrix from linear red, green and blue to CIE XYZ; white has luminance 1."""
    x, y = np.array([*PRIMARIES[primaries], D65]).T
    columns = np.stack([x / y, np.ones(4), (1 - x - y) / y])
    return columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3])


@lru_cache(maxsize=3)
def _light(transfer: int) -> Float32[np.ndarray, " n"]:
    """Light by number: of the display for PQ (1 for ``PEAK``), else of the scene."""
    if transfer == PQ:
        return (pq_to_nits(LEVELS) / PEAK).clip(max=1).astype(np.float32)
    if transfer != HLG:
        bright = ((LEVELS + 0.055) / 1.055) ** 2.4
        return np.where(LEVELS <= 0.04045, LEVELS / 12.92, bright).astype(np.float32)
    # The inverse OETF of HLG.
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    bright = (np.exp((LEVELS - c) / a) + b) / 12
    return np.where(LEVELS <= 0.5, LEVELS**2 / 3, bright).astype(np.float32)


@lru_cache(maxsize=1)
def _surround() -> Float32[np.ndarray, " n"]:
    """Light of a display of 1000 nits over that of the scene, by the luminance of the scene."""
    return (LEVELS**0.2).astype(np.float32)


@lru_cache(maxsize=1)
def _compression() -> Float32[np.ndarray, " n"]:
    """Light of sRGB, 1 for its white, over light of HDR, by the latter."""
    nits = PEAK * LEVELS.clip(min=LEVELS[1])
    return (compressed(nits) / WHITE * PEAK / nits).astype(np.float32)


@lru_cache(maxsize=1)
def _srgb() -> UInt8[np.ndarray, " n"]:
    """Numbers of sRGB by light."""
    curve = np.where(LEVELS <= 0.0031308, 12.92 * LEVELS, 1.055 * LEVELS ** (1 / 2.4) - 0.055)
    return (255 * curve + 0.5).astype(np.uint8)


def compressed(nits: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Nits of at most ``PEAK``, mapped to at most ``WHITE`` (the EETF of BT.2390)."""
    peak, white = nits_to_pq(np.array([PEAK, WHITE]))
    white /= peak
    knee = 1.5 * white - 0.5
    value = nits_to_pq(nits) / peak
    t = ((value - knee) / (1 - knee)).clip(0, 1)
    # A Hermite spline from the knee, where its slope is 1, to white, where it is 0.
    shoulder = (
        (2 * t**3 - 3 * t**2 + 1) * knee
        + (t**3 - 2 * t**2 + t) * (1 - knee)
        + (3 * t**2 - 2 * t**3) * white
    )
    return pq_to_nits(np.where(value < knee, value, shoulder) * peak)


M1, M2 = 2610 / 16384, 2523 / 4096 * 128
C1, C2, C3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
"""Constants of the PQ curve (ITU-R BT.2100-2, table 4)."""


def pq_to_nits(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Nits of the numbers of PQ, in [0, 1]."""
    power = values ** (1 / M2)
    return 10000 * ((power - C1).clip(min=0) / (C2 - C3 * power)) ** (1 / M1)


def nits_to_pq(nits: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Numbers of PQ, in [0, 1], of nits."""
    power = (nits / 10000) ** M1
    return ((C1 + C2 * power) / (1 + C3 * power)) ** M2
