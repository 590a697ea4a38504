"""PictureQuality: how sharp, bright and rich in contrast a decoded picture is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

BRIGHT, DARK = 250 / 255, 5 / 255
"""Pixels beyond are clipped: the sensor, or the conversion, kept nothing of what was there."""
BLURRED = 0.3
"""Of the set's median variance of the Laplacian (Pech-Pacheco et al. 2000): the least sharp
picture of the shared sets has 0.38, and a blur of 1.5 pixels takes 0.1."""
SOFT = 2e-5
"""Variance of the Laplacian in [0, 1] where a picture is blurred whatever the others are: the
softest median of the shared sets is 20 times that."""
EMPTY = 3 / 255
"""Standard deviation of a picture that shows nothing: compression noise alone."""
CLIPPED = 0.25
"""Part of what counts that is pure white or black; the shared photos have below 0.02."""
MEASURED_SIDE = 1024
"""Sharpness is measured on pictures of at most this long a side, all of one length: larger ones
are rarely sharp at every pixel."""


def lit_sharpness(sharpness: float, brightness: float, usual_brightness: float) -> float:
    """Sharpness as it would be in the usual light: a darker picture has weaker edges.

    Args:
        sharpness: variance of the Laplacian.
        brightness: mean grey level of the picture, in [0, 1].
        usual_brightness: of the set.
    """
    light = max(brightness, 1 / 255) / max(usual_brightness, 1 / 255)
    return sharpness / min(light, 1.0) ** 2


@dataclass(frozen=True)
class PictureQuality:
    """Figures of one picture, of the pixels that count."""

    sharpness: float
    """Variance of the Laplacian, in grey levels of [0, 1]."""
    brightness: float
    """Mean grey level, in [0, 1]."""
    contrast: float
    """Standard deviation of the grey levels."""
    clipped: float
    """Part that is nearly white or nearly black in every channel, in [0, 1]."""

    @staticmethod
    def of(
        colors: Float[np.ndarray, "h w d"], counts: Bool[np.ndarray, "h w"] | None = None
    ) -> PictureQuality:
        """Measure a picture.

        Args:
            colors: in [0, 1].
            counts: which pixels count; ``None`` for all.
        """
        grey = colors.mean(2)
        chosen = np.ones(grey.shape, bool) if counts is None else counts
        if not chosen.any():
            return PictureQuality(0.0, float(grey.mean()), 0.0, 0.0)
        clipped = np.asarray((colors >= BRIGHT).all(2) | (colors <= DARK).all(2))
        return PictureQuality(
            sharpness=float(ndimage.laplace(grey)[chosen].var()),
            brightness=float(grey[chosen].mean()),
            contrast=float(grey[chosen].std()),
            clipped=float(clipped[chosen].mean()),
        )
