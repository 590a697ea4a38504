"""The streams of SPZ: values in few bits, as the official encoder rounds them.

Largest errors: positions half of 2^-bits; opacities 1/510; ``f_dc`` 1/76.5 within -3.33 to 3.33;
logarithms of scales 1/32 within -10 to 5.94; SH bands 4.5/128 in the first, 8.5/128 in the others
(1/256 with 8 bits), within -1 to 0.99; rotations 0.5 degrees, 13 in version 2.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from jaxtyping import Float, Float32, Float64, UInt8, UInt32

from gsfw.core.maths.spherical_harmonics import num_coefficients
from gsfw.formats.activation import logits_of, to_bytes
from gsfw.formats.smallest_three import BOUND, from_smallest_three, smallest_three
from gsfw.formats.spz.layout import FIRST_THREE, HALVES, SpzHeader
from gsfw.formats.stored_rows import StoredRows

Bytes = UInt8[np.ndarray, " size"]

COLOR_STEPS, COLOR_CENTER = np.float32(0.15 * 255), np.float32(127.5)
"""Steps of ``f_dc``: colours a little outside of a screen's keep their values."""
SCALE_STEPS, LEAST_LOG_SCALE = np.float32(16), np.float32(-10)
SH_STEPS = 128
SH_BITS: Final = 4
"""Bits of an SH coefficient in the official encoder; the first band has one more."""
MAGNITUDES = 511
"""Largest magnitude of a stored component of a rotation."""
SIGN, MASK = 1 << 9, (1 << 10) - 1


def packed_base(rows: StoredRows, header: SpzHeader) -> tuple[bytes, ...]:
    """Some rows of all streams but the SH bands, in the order of the file."""
    pack = _packed_xyz if header.version <= FIRST_THREE else _packed_smallest_three
    return (
        _packed_positions(rows.means, header.bits).tobytes(),
        to_bytes(rows.opacities * 255).tobytes(),
        to_bytes(rows.dc * COLOR_STEPS + COLOR_CENTER).tobytes(),
        to_bytes((rows.log_scales - LEAST_LOG_SCALE) * SCALE_STEPS).tobytes(),
        pack(np.roll(rows.quats, -1, axis=1)).tobytes(),
    )


def packed_bands(rest: Float32[np.ndarray, "n k_minus_1 3"], bits: int = SH_BITS) -> bytes:
    """Some rows of the SH bands.

    Args:
        rest: all coefficients but the constant ones.
        bits: bits that coefficients keep, 8 at most, those of the first band one more: the steps
            of a bucket become one, so that bytes repeat and compress.
    """
    # Bounded before the cast, which very large values would overflow.
    steps = np.rint(rest.clip(-1, 1) * np.float32(SH_STEPS)).astype(np.int32) + SH_STEPS
    for columns, kept in ((slice(3), min(bits + 1, 8)), (slice(3, None), bits)):
        bucket = 1 << (8 - kept)
        steps[:, columns] = (steps[:, columns] + bucket // 2) // bucket * bucket
    return np.clip(steps, 0, 255).astype(np.uint8).tobytes()


def unpacked(streams: list[Bytes], header: SpzHeader) -> StoredRows:
    """All rows of a file, in its frame."""
    positions, alphas, colors, scales, rotations, *bands = streams
    count, rest = header.count, num_coefficients(header.degree) - 1
    sh = bands[0].astype(np.float32) if bands else np.zeros(0, dtype=np.float32)
    unpack = _unpacked_xyz if header.version <= FIRST_THREE else _unpacked_smallest_three
    return StoredRows(
        means=_unpacked_positions(positions.reshape(count, -1), header),
        logits=logits_of(np.arange(256) / 255.0)[alphas],
        dc=((colors - COLOR_CENTER) / COLOR_STEPS).reshape(count, 3),
        log_scales=(scales / SCALE_STEPS + LEAST_LOG_SCALE).reshape(count, 3),
        quats=np.roll(unpack(rotations.reshape(count, -1)), 1, axis=1),
        rest=((sh - SH_STEPS) / SH_STEPS).reshape(count, rest, 3),
    )


def _packed_positions(means: Float64[np.ndarray, "n 3"], bits: int) -> UInt8[np.ndarray, "n 9"]:
    """24-bit integers, little-endian."""
    steps = np.rint(means * 2.0**bits).astype("<i4")
    return steps.view(np.uint8).reshape(-1, 3, 4)[..., :3].reshape(-1, 9)


def _unpacked_positions(
    stored: UInt8[np.ndarray, "n bytes"], header: SpzHeader
) -> Float64[np.ndarray, "n 3"]:
    if header.version == HALVES:
        return stored.view("<f2").astype(np.float64)
    steps = np.zeros((len(stored), 3, 4), dtype=np.uint8)
    # In the upper three bytes the sign is where integers of 32 bits have it.
    steps[..., 1:] = stored.reshape(-1, 3, 3)
    return (steps.view("<i4")[..., 0] >> 8) / 2.0**header.bits


def _packed_xyz(quats: Float32[np.ndarray, "n 4"]) -> UInt8[np.ndarray, "n 3"]:
    """x, y and z of quaternions xyzw with w >= 0."""
    signs = np.where(quats[:, 3:] < 0, np.float32(-127.5), np.float32(127.5))
    return to_bytes(quats[:, :3] * signs + np.float32(127.5))


def _unpacked_xyz(stored: UInt8[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 4"]:
    xyz = stored / np.float32(127.5) - 1
    w = np.sqrt(np.maximum(1 - (xyz * xyz).sum(axis=1, keepdims=True), 0))
    return np.concatenate([xyz, w], axis=1)


def _packed_smallest_three(quats: Float32[np.ndarray, "n 4"]) -> UInt32[np.ndarray, " n"]:
    """2 bits: which of x, y, z, w is the largest; 3 x 10: signs and magnitudes of the others."""
    largest, three = smallest_three(quats)
    # By rounding, a component may be above its bound.
    sizes = np.minimum(np.abs(three) * (MAGNITUDES / BOUND) + 0.5, MAGNITUDES).astype(np.uint32)
    fields = sizes | np.where(three < 0, np.uint32(SIGN), np.uint32(0))
    packed = largest.astype(np.uint32)
    for column in range(3):
        packed = (packed << np.uint32(10)) | fields[:, column]
    return packed.astype("<u4")


def _unpacked_smallest_three(stored: UInt8[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    packed = stored.view("<u4")[:, 0].astype(np.int64)
    fields = np.stack([packed >> shift & MASK for shift in (20, 10, 0)], axis=1)
    sizes = (fields & MAGNITUDES) * np.float32(BOUND / MAGNITUDES)
    three = np.where(fields & SIGN, -sizes, sizes).astype(np.float32)
    return from_smallest_three(packed >> 30, three)
