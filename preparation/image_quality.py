"""Quality of decoded images: sharpness, brightness and contrast, alone and beside the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

BRIGHT, DARK = 250 / 255, 5 / 255
"""Pixels beyond are clipped: the sensor, or the conversion, lost all detail there."""
BLURRED = 0.3
"""Blurred images have less than this part of the usual variance of the Laplacian (Pech-Pacheco et
al. 2000): the least sharp image of the shared sets has 0.38, and a blur of 1.5 pixels takes
0.1."""
SOFT = 2e-5
"""Variance of the Laplacian in [0, 1] below which an image is blurred beside any others: the
softest median of the shared sets is 20 times that."""
EMPTY = 3 / 255
"""Standard deviation of an image without content: compression noise alone."""
PLAIN = 0.4
"""Plain images have less than this part of the usual contrast: walls with a shade of light have
0.16 to 0.2; a blur of 12 pixels, another thing, leaves 0.9."""
CLIPPED = 0.25
"""Part of the counted pixels that is pure white or black; the shared photos have below 0.02."""
MEASURED_SIDE = 1024
"""Sharpness is measured on images of at most this long a side, all of one length: larger ones
are rarely sharp at every pixel."""


@dataclass(frozen=True)
class ImageQuality:
    """Figures of one image, of the pixels that count."""

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
    ) -> ImageQuality:
        """Measure an image.

        Args:
            colors: in [0, 1].
            counts: which pixels count; ``None`` for all.
        """
        grey = colors.mean(2)
        chosen = np.ones(grey.shape, bool) if counts is None else counts
        if not chosen.any():
            return ImageQuality(0.0, float(grey.mean()), 0.0, 0.0)
        clipped = np.asarray((colors >= BRIGHT).all(2) | (colors <= DARK).all(2))
        return ImageQuality(
            sharpness=float(ndimage.laplace(grey)[chosen].var()),
            brightness=float(grey[chosen].mean()),
            contrast=float(grey[chosen].std()),
            clipped=float(clipped[chosen].mean()),
        )


@dataclass(frozen=True)
class UsualQuality:
    """Typical figures of a capture's images, to compare single images with."""

    brightness: float
    contrast: float
    clipped: float
    sharpness: float
    """Sharpness in light of the usual brightness."""

    @staticmethod
    def of(qualities: Sequence[ImageQuality], quantile: float = 0.5) -> UsualQuality:
        """Typical figures of some images; zeros for none.

        Args:
            qualities: of the images.
            quantile: of contrast and sharpness, of which more is better; all others are medians.
        """
        known = qualities or [ImageQuality(0.0, 0.0, 0.0, 0.0)]
        brightness = float(np.median([one.brightness for one in known]))
        sharpness = [_lit_sharpness(one, brightness) for one in known]
        return UsualQuality(
            brightness=brightness,
            contrast=float(np.quantile([one.contrast for one in known], quantile)),
            clipped=float(np.median([one.clipped for one in known])),
            sharpness=float(np.quantile(sharpness, quantile)),
        )

    def sharpness_of(self, quality: ImageQuality) -> float:
        """Sharpness of an image in light of the usual brightness."""
        return _lit_sharpness(quality, self.brightness)

    def share_of_sharpness(self, quality: ImageQuality) -> float:
        """The same in parts of the usual sharpness."""
        return self.sharpness_of(quality) / max(self.sharpness, 1e-12)

    def is_blurred(self, quality: ImageQuality) -> bool:
        """True if an image is blurred beside the others."""
        return self.share_of_sharpness(quality) < BLURRED

    def is_plain(self, quality: ImageQuality) -> bool:
        """True if an image has far less contrast than the others."""
        return quality.contrast < PLAIN * self.contrast


def _lit_sharpness(quality: ImageQuality, usual_brightness: float) -> float:
    """Sharpness as it would be in the usual light: a darker image has weaker edges."""
    light = max(quality.brightness, 1 / 255) / max(usual_brightness, 1 / 255)
    return quality.sharpness / min(light, 1.0) ** 2
