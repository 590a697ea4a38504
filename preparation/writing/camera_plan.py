"""CameraPlan: what becomes of a lens and of its images in a data set that is written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float64

from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.undistortion import LensRule, Undistortion, undistortion_of

STRAIGHT = 0.05
"""Pixels. Where distortion moves none by more, images are copied: that is less than the error of
a good reconstruction (0.5 to 1 pixel), and rewriting a JPEG would cost more than it mends."""
GRID = 33
"""Pixels per side of the grid on which distortion is measured."""


@dataclass(frozen=True)
class CameraPlan:
    """Leads from the lens of given images to that of the written ones."""

    source: Lens
    target: Lens
    undistortion: Undistortion | None
    """``None`` where pixels stay as they are."""

    @staticmethod
    @lru_cache(maxsize=4096)
    def of(lens: Lens, keep: bool) -> CameraPlan:
        """The plan for a lens of images in their stored size.

        Raises:
            DataError: the distortion folds the image over, or nothing would be left of it.
        """
        if keep:
            return CameraPlan(lens, lens, None)
        if distortion_in_pixels(lens) <= STRAIGHT:
            return CameraPlan(lens, replace(lens, model="PINHOLE", distortion=()), None)
        found = undistortion_of(lens, LensRule())
        return CameraPlan(lens, found.target, found)

    def moved(
        self, pixels: Float64[np.ndarray, "m 2"]
    ) -> tuple[Float64[np.ndarray, "m 2"], Bool[np.ndarray, " m"]]:
        """Positions of source pixels in the written images, and a mask of those inside."""
        if self.undistortion is None:
            return pixels, np.ones(len(pixels), dtype=bool)
        found = self.target.project(self.source.unproject(pixels))
        x, y = found[:, 0], found[:, 1]
        # Comparisons with nan, where no ray leads to a pixel, are false.
        inside = (x >= 0) & (x <= self.target.width) & (y >= 0) & (y <= self.target.height)
        return found, inside


def distortion_in_pixels(lens: Lens) -> float:
    """Largest shift of a pixel by distortion; infinite where a pixel has no ray."""
    if lens.is_pinhole:
        return 0.0
    x, y = np.meshgrid(np.linspace(0, lens.width, GRID), np.linspace(0, lens.height, GRID))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    straight = replace(lens, model="PINHOLE", distortion=())
    shifts = np.linalg.norm(straight.project(lens.unproject(pixels)) - pixels, axis=1)
    return float(np.nan_to_num(shifts, nan=np.inf).max())


def lens_words(plans: Sequence[CameraPlan]) -> str:
    """Description of the output lenses, given the plan of every image."""
    parts = []
    for model in dict.fromkeys(plan.source.model for plan in plans):
        own = [plan for plan in plans if plan.source.model == model]
        changed = [plan.undistortion for plan in own if plan.undistortion is not None]
        if changed:
            lost = max(each.lost for each in changed)
            parts.append(
                f"PINHOLE, undistorted from {model} (up to {100 * lost:.1f} % of an image fell "
                "outside)"
            )
        if len(changed) < len(own):
            kept = next(plan.target.model for plan in own if plan.undistortion is None)
            parts.append(
                f"{kept} as given" if kept == model else f"{kept}, as {model} was almost straight"
            )
    return "; ".join(dict.fromkeys(parts))
