"""Activation: opacities and base colours as files hold them that need no logits."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32, UInt8

from gsfw.core.maths.spherical_harmonics import C0
from gsfw.formats.stored_rows import MAX_LOGIT, MIN_LOG_SCALE, MIN_LOGIT


def logits_of(opacities: Float[np.ndarray, " n"]) -> Float32[np.ndarray, " n"]:
    """The logits of opacities, which are clamped to [0, 1]; NaN stays."""
    alpha = np.clip(opacities.astype(np.float64), 0, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        logits = np.log(alpha) - np.log1p(-alpha)
    return np.clip(logits, MIN_LOGIT, MAX_LOGIT).astype(np.float32)


def log_scales_of(scales: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
    """The logarithms of scales; NaN for negative ones, which no Gaussian has."""
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(scales.astype(np.float64))
    return np.maximum(logs, MIN_LOG_SCALE).astype(np.float32)


def to_bytes(values: Float[np.ndarray, "*b"]) -> UInt8[np.ndarray, "*b"]:
    """The nearest of 0 to 255."""
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def dc_of(rgb: Float[np.ndarray, "n 3"]) -> Float32[np.ndarray, "n 3"]:
    """The constant SH coefficients of colours."""
    return ((rgb - 0.5) / C0).astype(np.float32)
