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

PSNR_MAX = 100.0
"""PSNR of two equal images, in dB; finite, so that means stay finite."""

LEAST_CONTRAST = 0.02
"""Least contrast of an image that shows something, of colours in [0, 1]: 5 of 255 levels."""

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


def is_one_color(
    rendered: Float[Tensor, "h w d"],
    target: Float[Tensor, "h w d"],
    valid: Bool[Tensor, "h w 1"] | None = None,
) -> bool:
    """True if a render is (nearly) one colour and its target is not."""
    expected = contrast(target, valid)
    return expected > LEAST_CONTRAST and contrast(rendered, valid) < ONE_COLOR * expected


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
