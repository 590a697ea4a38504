"""Quantisation of SOG: means, rotations and opacities as bytes, and back.

Errors: a coordinate p of step s, the range of sign(p) ln(|p| + 1) over 65,535, is wrong by at most
(|p| + 1)(exp(s / 2) - 1); an opacity by 1/510; a component of a rotation by e = sqrt(2) / 510. The
three that are stored are no longer than sqrt(3/4) + sqrt(3) e, so the largest changes by at most
1.78 times what they do, and the splat is turned by at most 2 sqrt(1 + 1.78^2) sqrt(3) e radians:
1.13 degrees.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Float64, UInt8, UInt16

from gsfw.formats.smallest_three import BOUND, from_smallest_three, smallest_three

MAX_MEAN = (1 << 16) - 1
MAX_BYTE = 255
FIRST_TAG = 252
"""Alpha of a rotation whose largest component is w; the next are for x, y and z."""
LEAST_OPACITY = 1e-6
"""Opacities are read no nearer to 0 and 1 than that, as by splat-transform."""


def to_logarithm(values: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
    """sign(p) ln(|p| + 1): nearly linear around 0, so that near things are stored finely."""
    return np.sign(values) * np.log1p(np.abs(values))


def from_logarithm(values: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
    """Inverse of ``to_logarithm``."""
    return np.sign(values) * np.expm1(np.abs(values))


def pack_means(
    means: Float64[np.ndarray, "n 3"],
    low: Float64[np.ndarray, " 3"],
    high: Float64[np.ndarray, " 3"],
) -> UInt16[np.ndarray, "n 3"]:
    """Means as parts of the range between two logarithms."""
    size = np.where(high > low, high - low, 1.0)
    parts = np.rint((to_logarithm(means) - low) / size * MAX_MEAN)
    return np.clip(parts, 0, MAX_MEAN).astype(np.uint16)


def unpack_means(
    parts: UInt16[np.ndarray, "n 3"],
    low: Float64[np.ndarray, " 3"],
    high: Float64[np.ndarray, " 3"],
) -> Float64[np.ndarray, "n 3"]:
    """Inverse of ``pack_means``."""
    return from_logarithm(low + (high - low) * (parts / MAX_MEAN))


def pack_quats(quats: Float32[np.ndarray, "n 4"]) -> UInt8[np.ndarray, "n 4"]:
    """Smallest three as red, green and blue, the index of the largest in alpha."""
    largest, three = smallest_three(quats)
    parts = np.clip(np.rint((three / BOUND + 1) * (MAX_BYTE / 2)), 0, MAX_BYTE)
    return np.concatenate([parts, FIRST_TAG + largest[:, None]], axis=1).astype(np.uint8)


def unpack_quats(texels: UInt8[np.ndarray, "n 4"]) -> Float32[np.ndarray, "n 4"]:
    """Inverse of ``pack_quats``; tags are FIRST_TAG and above."""
    three = (texels[:, :3] * (2 / MAX_BYTE) - 1) * BOUND
    quats = from_smallest_three(texels[:, 3].astype(np.int64) - FIRST_TAG, three)
    return quats.astype(np.float32)


def pack_opacities(logits: Float32[np.ndarray, " n"]) -> UInt8[np.ndarray, " n"]:
    """Opacities in 255 steps."""
    # A logit is at least MIN_LOGIT, whose exponential float64 holds.
    opacities = 1 / (1 + np.exp(-logits.astype(np.float64)))
    return np.rint(opacities * MAX_BYTE).astype(np.uint8)


def unpack_opacities(steps: UInt8[np.ndarray, " n"]) -> Float32[np.ndarray, " n"]:
    """The logits."""
    opacities = np.clip(steps / MAX_BYTE, LEAST_OPACITY, 1 - LEAST_OPACITY)
    return np.log(opacities / (1 - opacities)).astype(np.float32)
