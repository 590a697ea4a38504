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
SOFT_EDGES = 0.7
"""Blurred images also have at most this part of the usual sharpness of edges: single photos of
fox and plush have 0.8 and more, 0.43 to 0.61 after a blur of 1 pixel, and at most 0.5 after a
motion of 5. Sharp images through a longer lens have less fine detail, and 0.8 and more of this."""
STRONG = 0.02
"""Part of the pixels that has the strongest edges: more than a date in a corner."""
DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Steps in rows and columns across which edges are measured, as motion leaves some sharp."""
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
    edges: float = 0.0
    """Sharpness of the strongest edges, in the direction in which they are softest: second over
    first differences of grey levels, about 1; 0 where it was not measured, or there is none."""

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
            edges=_sharpness_of_edges(grey, counts),
        )


@dataclass(frozen=True)
class UsualQuality:
    """Typical figures of a capture's images, to compare single images with."""

    brightness: float
    contrast: float
    clipped: float
    sharpness: float
    """Sharpness in light of the usual brightness."""
    edges: float
    """Sharpness of edges."""

    @staticmethod
    def of(qualities: Sequence[ImageQuality], quantile: float = 0.5) -> UsualQuality:
        """Typical figures of some images; zeros for none.

        Args:
            qualities: of the images.
            quantile: of contrast and both kinds of sharpness, of which more is better; all others
                are medians.
        """
        known = qualities or [ImageQuality(0.0, 0.0, 0.0, 0.0)]
        brightness = float(np.median([one.brightness for one in known]))
        sharpness = [_lit_sharpness(one, brightness) for one in known]
        return UsualQuality(
            brightness=brightness,
            contrast=float(np.quantile([one.contrast for one in known], quantile)),
            clipped=float(np.median([one.clipped for one in known])),
            sharpness=float(np.quantile(sharpness, quantile)),
            edges=float(np.quantile([one.edges for one in known], quantile)),
        )

    def sharpness_of(self, quality: ImageQuality) -> float:
        """Sharpness of an image in light of the usual brightness."""
        return _lit_sharpness(quality, self.brightness)

    def share_of_sharpness(self, quality: ImageQuality) -> float:
        """The same in parts of the usual sharpness."""
        return self.sharpness_of(quality) / max(self.sharpness, 1e-12)

    def is_blurred(self, quality: ImageQuality) -> bool:
        """True if an image is blurred beside the others: it lacks fine detail and sharp edges.

        Smooth things, and all things through a longer lens, have little fine detail as well.
        """
        is_soft = quality.edges <= SOFT_EDGES * self.edges
        return is_soft and self.share_of_sharpness(quality) < BLURRED

    def is_plain(self, quality: ImageQuality) -> bool:
        """True if an image has far less contrast than the others."""
        return quality.contrast < PLAIN * self.contrast


def _lit_sharpness(quality: ImageQuality, usual_brightness: float) -> float:
    """Sharpness as it would be in the usual light: a darker image has weaker edges."""
    light = max(quality.brightness, 1 / 255) / max(usual_brightness, 1 / 255)
    return quality.sharpness / min(light, 1.0) ** 2


def _sharpness_of_edges(
    grey: Float[np.ndarray, "h w"], counts: Bool[np.ndarray, "h w"] | None
) -> float:
    """``ImageQuality.edges``; borders of images and of what counts are no edges."""
    margin = 2
    inner = np.zeros(grey.shape, bool)
    inner[margin:-margin, margin:-margin] = True
    if counts is not None:
        inner &= ndimage.binary_erosion(counts, np.ones((3, 3), bool), iterations=margin)
    if not inner.any():
        return 0.0
    return min(_edge_along(grey, inner, step) for step in DIRECTIONS)


def _edge_along(
    grey: Float[np.ndarray, "h w"], inner: Bool[np.ndarray, "h w"], step: tuple[int, int]
) -> float:
    """Second over first differences along a step, at its strongest edges (median)."""

    def moved(values: Float[np.ndarray, "h w"], sign: int) -> Float[np.ndarray, "h w"]:
        return np.roll(values, (sign * step[0], sign * step[1]), (0, 1))

    before, after = moved(grey, 1), moved(grey, -1)
    first, second = np.abs(after - before) / 2, np.abs(after + before - 2 * grey)
    strong = inner & (first > 0) & (first >= np.quantile(first[inner], 1 - STRONG))
    # Second differences are least in the middle of an edge, where first ones are largest.
    nearby = np.maximum(second, np.maximum(moved(second, 1), moved(second, -1)))
    return float(np.median(nearby[strong] / first[strong])) if strong.any() else 0.0
