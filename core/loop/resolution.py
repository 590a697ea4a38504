"""Resolution schedule: training starts on small images, which grow as there is more to learn.

The idea is that of Chen et al. 2025, "DashGaussian" (arXiv 2503.18402): a model learns low
frequencies first, small images hold them, and the spectra of the training images say for how
long they do. Let K(f) be the part of their detail that images smaller by a factor f keep, and S
the step by which images are full. Step s is trained at the largest f with S K(f) > s: each size
gets the share of the steps by which it adds detail to the size before.

Where we differ: sizes are powers of the square root of 2 under an exact area filter, S is a
setting, and the growth of the model is left to strategies. By default S is 60 % of the steps in
which ADC adds rows: fine detail can only be added, and find its place, once images are full.

Gradients of screen positions are in NDC units, so that thresholds mean the same at every size.
Radii in pixels do not. Without antialias each splat is drawn about half a pixel wider than it is,
so that those fitted to small images look too thin in full ones until training has widened them.
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

FACTORS = tuple(2 ** (i / 2) for i in range(1, 7))
"""What sides are divided by, besides 1: each halves the pixels of the one before, down to 1/64."""

MIN_SIDE = 64
"""Pixels that the short side keeps: a sixth of them is so near the border that the 11-pixel window
of SSIM hangs over it, and with fewer the border would dominate."""

MIN_STEPS = 300
"""Shorter schedules do nothing: every view is hardly seen once before images are full."""

START_DETAIL = 0.25
"""Training starts at the smallest size that keeps this part of the detail."""

MEASURED_VIEWS = 8
"""Spectra of this many training views, spread evenly, are measured."""


@dataclass(frozen=True)
class ResolutionSchedule:
    """How large the images of each step are: a pure function of the step."""

    stages: tuple[tuple[int, float], ...] = ()
    """First step (counted from 0) and factor that sides are divided by, the last one 1; empty
    where images are full from the beginning."""

    def factor(self, step: int) -> float:
        """What the sides of the images of ``step`` are divided by; at least 1."""
        return next((factor for first, factor in reversed(self.stages) if step >= first), 1.0)

    @property
    def full_from(self) -> int:
        """The first step, counted from 0, whose images are full."""
        return self.stages[-1][0] if self.stages else 0

    def reduce(self, batch: Batch, step: int) -> Batch:
        """What ``step`` trains on; a full-size batch is returned as it is."""
        width, height = reduced_size(batch.cameras.width, batch.cameras.height, self.factor(step))
        return shrink_batch(batch, width, height)

    def note(self, steps: int) -> str:
        """What the user should know of a schedule that was to be full after ``steps``."""
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
    """The most that an image may be reduced by: 1 for those that are small already."""
    return max(1.0, min(width, height) / MIN_SIDE)


def reduced_size(width: int, height: int, factor: float) -> tuple[int, int]:
    """Width and height in pixels, divided by ``factor`` or by what is left of it for small ones."""
    factor = min(factor, largest_factor(width, height))
    return round(width / factor), round(height / factor)


def planned(kept: Mapping[float, float], steps: int) -> ResolutionSchedule:
    """The schedule for images of known detail.

    Args:
        kept: the part of their detail, from 0 to 1, that is left at each factor above 1.
        steps: after which images are full, whatever their detail.
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
    """The schedule for the training views of a data set; the same whenever it is asked for.

    Args:
        data: whose images are looked at, some of them.
        background: behind images that have alpha, in [0, 1].
        steps: after which images are full.
    """
    cameras = data.views(Split.TRAIN).cameras
    limit = max(largest_factor(camera.width, camera.height) for camera in cameras)
    factors = [factor for factor in FACTORS if factor <= limit]
    if steps < MIN_STEPS or not factors:
        return FULL_SIZE
    count = min(MEASURED_VIEWS, len(cameras))
    views = [index * len(cameras) // count for index in range(count)]
    parts = np.mean(
        [detail_kept(_brightness(data, view, background), factors) for view in views], 0
    )
    # Rounding makes the steps the same on machines whose sums differ in their last bits.
    return planned(dict(zip(factors, parts.round(3).tolist(), strict=True)), steps)


def _brightness(
    data: DataManager, view: int, background: Float[Tensor, " 3"]
) -> Float[np.ndarray, "h w"]:
    """A training image in grey over the background; what its mask hides is of mean brightness."""
    (batch,) = data.load(Split.TRAIN, [view], torch.device("cpu"))
    grey = batch.target(background.cpu()).mean(-1)[0]
    if batch.valid is not None:
        valid = batch.valid[0, :, :, 0]
        mean = grey[valid].mean() if bool(valid.any()) else grey.mean()
        grey = torch.where(valid, grey, mean)
    return np.asarray(grey.numpy())
