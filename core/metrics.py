"""Metrics: similarity of a rendered image and the photo."""

from __future__ import annotations

import logging
import math
from abc import ABC, abstractmethod

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.maths.ssim import masked_mean
from gsfw.core.operators import Operators

logger = logging.getLogger("gsfw.run")

USUAL_METRICS = ("psnr", "ssim")
"""Metrics that stand before all others."""

PSNR_MAX = 100.0
"""PSNR of two equal images, in dB; finite, so that means stay finite."""

LEAST_CONTRAST = 0.02
"""Least contrast of an image that shows something, of colours in [0, 1]: 5 of 255 levels."""

COLOR_NOISE = 0.1 / 255
"""Standard deviation of colours, in [0, 1], that says nothing of a map: a tenth of a level."""

ONE_COLOR = 0.1
"""A render with less than this part of its target's contrast shows nothing of it. Measured: at
most 0.08 in a white run (4dgs, mujoco_collision), at least 0.50 in sound ones of 500 steps."""


def psnr(
    rendered: Float[Tensor, "h w d"],
    target: Float[Tensor, "h w d"],
    valid: Bool[Tensor, "h w 1"] | None = None,
) -> float:
    """Peak signal-to-noise ratio in dB, of values clamped to [0, 1]."""
    squared = (rendered.clamp(0, 1) - target.clamp(0, 1)).double() ** 2
    mean = masked_mean(squared[None], None if valid is None else valid[None])
    return float((-10.0 * torch.log10(mean)).clamp_max(PSNR_MAX))


def contrast(image: Float[Tensor, "h w d"], valid: Bool[Tensor, "h w 1"] | None = None) -> float:
    """Standard deviation of the colours of an image, of values clamped to [0, 1].

    The root mean square over the channels; 0 for one colour, or without valid pixels.
    """
    pixels = image.clamp(0, 1).flatten(0, 1) if valid is None else image.clamp(0, 1)[valid[..., 0]]
    if not len(pixels):
        return 0.0
    return float(pixels.double().var(dim=0, correction=0).mean().sqrt())


def is_hidden(valid: Bool[Tensor, "*c h w 1"] | None) -> bool:
    """True if no pixel is valid, so that there is nothing to compare."""
    return valid is not None and not bool(valid.any())


def is_one_color(
    rendered: Float[Tensor, "h w d"],
    target: Float[Tensor, "h w d"],
    valid: Bool[Tensor, "h w 1"] | None = None,
) -> bool:
    """True if a render is (nearly) one colour and its target is not."""
    expected = contrast(target, valid)
    return expected > LEAST_CONTRAST and contrast(rendered, valid) < ONE_COLOR * expected


def color_corrected(
    rendered: Float[Tensor, "h w 3"],
    target: Float[Tensor, "h w 3"],
    valid: Bool[Tensor, "h w 1"] | None = None,
) -> Float[Tensor, "h w 3"]:
    """The render after the affine map of its colours that fits its target best, not clamped.

    The map minimizes the squared error over the valid pixels, of values clamped to [0, 1], plus
    ``COLOR_NOISE`` squared times that of its linear part to the identity, for each pixel. So it is
    unique for images of one colour and for few pixels, and never fits worse than no map.
    """
    image, photo = rendered.clamp(0, 1).double(), target.clamp(0, 1).double()
    chosen = ... if valid is None else valid[..., 0]
    colors, wanted = image[chosen].reshape(-1, 3), photo[chosen].reshape(-1, 3)
    count, unit = len(colors), torch.eye(3, dtype=torch.float64, device=image.device)
    if not count:
        return rendered
    middle, center = colors.mean(dim=0), wanted.mean(dim=0)
    # Moments less those of the means: colours in [0, 1] leave 9 digits of COLOR_NOISE's square.
    own = colors.mT @ colors / count - torch.outer(middle, middle)
    both = colors.mT @ wanted / count - torch.outer(middle, center)
    noise = COLOR_NOISE**2 * unit
    # Without an error for an image that is not finite: its map is not either.
    gains, _ = torch.linalg.solve_ex(own + noise, both + noise)
    return (image @ gains + (center - middle @ gains)).to(rendered.dtype)


class Metric(ABC):
    """A figure of one held-out image; results show the mean over the views.

    A metric of a plugin that raises is NaN, with one warning, and the run continues.
    """

    def __init__(self, operators: Operators | None = None) -> None:
        """Use the operators of the run's device; ``None`` for plain torch."""
        self.operators = operators or Operators()

    @abstractmethod
    def __call__(
        self,
        rendered: Float[Tensor, "h w 3"],
        target: Float[Tensor, "h w 3"],
        valid: Bool[Tensor, "h w 1"] | None,
    ) -> float:
        """Compare one image over its valid pixels.

        Args:
            rendered: colours as rendered, over the background; not clamped.
            target: the image over the same background, in [0, 1].
            valid: true where a pixel counts; ``None`` when all do. The figure must not depend on
                the others.
        """


class CautiousMetric(Metric):
    """A metric of a third party: NaN if it fails; the failure is logged once."""

    def __init__(self, metric: Metric, name: str) -> None:
        super().__init__()
        self._metric, self._name = metric, name
        self._has_failed = False

    def __call__(self, rendered: Tensor, target: Tensor, valid: Tensor | None) -> float:
        """Compare one image."""
        try:
            return float(self._metric(rendered, target, valid))
        except Exception as error:
            if not self._has_failed:
                logger.warning(
                    "%s failed; its figures are NaN: %s: %s",
                    self._name,
                    type(error).__name__,
                    error,
                    exc_info=True,
                )
            self._has_failed = True
            return math.nan


class Psnr(Metric):
    """Peak signal-to-noise ratio, in dB."""

    def __call__(self, rendered: Tensor, target: Tensor, valid: Tensor | None) -> float:
        """Compare one image."""
        return psnr(rendered, target, valid)


class ColorCorrectedPsnr(Metric):
    """PSNR after the best affine map of the render's colours, in dB; never below PSNR.

    It judges shapes apart from exposure and white balance, which the photo alone tells.
    """

    def __call__(self, rendered: Tensor, target: Tensor, valid: Tensor | None) -> float:
        """Compare one image."""
        return psnr(color_corrected(rendered, target, valid), target, valid)


class Ssim(Metric):
    """Structural similarity with the loss's window, of values clamped to [0, 1]."""

    def __call__(self, rendered: Tensor, target: Tensor, valid: Tensor | None) -> float:
        """Compare one image."""
        image = rendered.clamp(0, 1)
        if valid is None:
            return 1.0 - float(self.operators.l1_dssim(image[None], target[None])[1])
        # Windows reach across the border of a mask: beyond it, as beyond an image, there are zeros.
        image, target = image * valid, target * valid
        return 1.0 - float(self.operators.l1_dssim(image[None], target[None], valid[None])[1])
