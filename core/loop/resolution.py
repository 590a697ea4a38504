"""Resolution schedule: training starts on small images, which grow with the detail to be learnt.

The idea is that of Chen et al. 2025, "DashGaussian" (arXiv 2503.18402): a model learns low
frequencies first, small images hold them, and the spectra of the training images set the duration.
Let K(f) be the fraction of their detail that images smaller by a factor f keep, and S the first
step with full images. Step s is trained at the largest f with S K(f) > s: each size gets the share
of the steps by which it adds detail to the previous size.

Differences: sizes are powers of the square root of 2 under an exact area filter, S is a setting,
and strategies control the growth of the model. By default S is 60 % of the steps in which ADC adds
rows: fine detail can only be added and fitted once images are full.

Gradients of screen positions are in NDC units, so that thresholds mean the same at every size.
Radii in pixels do not. Without antialias each splat is rendered about half a pixel too wide, so
that splats that fit small images are too thin in full ones until training has widened them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.loop.area import shrink_batch
from gsfw.core.loop.spectrum import detail_kept
from gsfw.core.progress import tracked

FACTORS = tuple(2 ** (i / 2) for i in range(1, 7))
"""Divisors of the sides, besides 1: each halves the pixels of the previous one, down to 1/64."""

MIN_SIDE = 64
"""Least pixels of the short side: within a sixth of them the 11-pixel window of SSIM crosses the
border, and with fewer pixels the border would dominate."""

MIN_STEPS = 300
"""Shorter schedules have no effect: images are full before every view is seen once."""

START_DETAIL = 0.25
"""Training starts at the smallest size that keeps this fraction of the detail."""

MEASURED_VIEWS = 8
"""Number of training views, spread evenly, whose spectra are measured."""


@dataclass(frozen=True)
class ResolutionSchedule:
    """Image size of each step, as a pure function of the step."""

    stages: tuple[tuple[int, float], ...] = ()
    """First step (counted from 0) and divisor of the sides, the last one 1; empty if all images
    are full."""

    def factor(self, step: int) -> float:
        """Divisor of the sides of the images at ``step``; at least 1."""
        return next((factor for first, factor in reversed(self.stages) if step >= first), 1.0)

    @property
    def full_from(self) -> int:
        """The first step, counted from 0, whose images are full."""
        return self.stages[-1][0] if self.stages else 0

    def reduce(self, batch: Batch, step: int) -> Batch:
        """Shrink a batch for ``step``; a full-size batch is returned unchanged."""
        width, height = reduced_size(batch.cameras.width, batch.cameras.height, self.factor(step))
        return shrink_batch(batch, width, height)

    def note(self, steps: int) -> str:
        """Note for the user on a schedule that reaches full images after ``steps``."""
        if self.stages:
            return (
                f"Images start at 1/{self.factor(0):.2g} of their size and reach full size after "
                f"{self.full_from} steps (resolution_schedule=auto)."
            )
        least = math.ceil(MIN_SIDE * FACTORS[0])
        return (
            "resolution_schedule=auto leaves all images at full size: it takes resolution_steps "
            f"of at least {MIN_STEPS} (here {steps}), and images of at least {least} pixels on "
            "the short side that keep a quarter of their detail when they shrink."
        )


FULL_SIZE = ResolutionSchedule()
"""Full images from the first step on."""


def largest_factor(width: int, height: int) -> float:
    """The largest allowed divisor of an image; 1 for small images."""
    return max(1.0, min(width, height) / MIN_SIDE)


def reduced_size(width: int, height: int, factor: float) -> tuple[int, int]:
    """Width and height in pixels, divided by ``factor`` or by the largest allowed divisor."""
    factor = min(factor, largest_factor(width, height))
    return round(width / factor), round(height / factor)


def planned(kept: Mapping[float, float], steps: int) -> ResolutionSchedule:
    """The schedule for images of known detail.

    Args:
        kept: fraction of their detail, from 0 to 1, at each factor above 1.
        steps: upper bound of the steps before images are full.
    """
    stages: list[tuple[int, float]] = []
    done = 0
    for factor, part in sorted(kept.items(), reverse=True):
        end = round(steps * part)
        if part >= START_DETAIL and end > done:
            stages.append((done, factor))
            done = end
    return ResolutionSchedule((*stages, (done, 1.0)) if stages else ())


def measured(data: DataManager, background: Float[Tensor, " 3"], steps: int) -> ResolutionSchedule:
    """The schedule for the training views of a data set; the same at every call.

    Args:
        data: some of its images are measured.
        background: background of images with alpha, in [0, 1].
        steps: steps before images are full.
    """
    cameras = data.views(Split.TRAIN).cameras
    limit = max(largest_factor(camera.width, camera.height) for camera in cameras)
    factors = [factor for factor in FACTORS if factor <= limit]
    if steps < MIN_STEPS or not factors:
        return FULL_SIZE
    count = min(MEASURED_VIEWS, len(cameras))
    views = [index * len(cameras) // count for index in range(count)]
    parts = np.mean(
        [
            detail_kept(_brightness(data, view, background), factors)
            for view in tracked(views, "measuring the detail of images", len(views))
        ],
        0,
    )
    # Rounding gives the same steps on machines with different last bits of sums.
    return planned(dict(zip(factors, parts.round(3).tolist(), strict=True)), steps)


def _brightness(
    data: DataManager, view: int, background: Float[Tensor, " 3"]
) -> Float[np.ndarray, "h w"]:
    """A training image in grey over the background; masked pixels have the mean brightness."""
    (batch,) = data.load(Split.TRAIN, [view], torch.device("cpu"))
    grey = batch.target(background.cpu()).mean(-1)[0]
    if batch.valid is not None:
        valid = batch.valid[0, :, :, 0]
        mean = grey[valid].mean() if bool(valid.any()) else grey.mean()
        grey = torch.where(valid, grey, mean)
    return np.asarray(grey.numpy())
