"""PixelMap: where the pixels of an undistorted picture come from, ready for interpolation.

Torch's cubic kernels (Keys 1981, a = -0.75) draw a value up to 0.05 pixels beside where it was
asked for. Asking as far to the other side makes up for that, and costs nothing as it is in the map:
what is straight stays straight, which otherwise needs a = -0.5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64
from torch import Tensor

from gsfw.datamanagers.undistortion import Undistortion

ROWS = 128
"""Of a map that are computed at once, for the memory that rays take in float64."""
STEPS = 8192
"""Parts of a pixel that positions are corrected by; half of one is 6e-5 pixels."""
BETWEEN = np.linspace(0.0, 1.0, STEPS + 1)
"""Positions between the centres of two pixels."""
DRAWN = BETWEEN - 0.5 * BETWEEN * (1 - BETWEEN) * (2 * BETWEEN - 1)
"""For each, the kernel's centre of gravity: sum of w(i - t) i over four pixels."""
ASKED = np.interp(BETWEEN, DRAWN, BETWEEN)
"""What to ask for so that the centre of gravity is there."""


@dataclass(frozen=True)
class PixelMap:
    """Where the pixels of an undistorted picture come from."""

    positions: Float[Tensor, "h w 2"]
    """What to ask torch for: x and y in [-1, 1] from border to border of the distorted picture."""
    seen: Bool[Tensor, "h w"] | None
    """False where the lens saw nothing; ``None`` when it saw all."""

    @property
    def bytes(self) -> int:
        """Memory that it takes."""
        return self.positions.nbytes + (0 if self.seen is None else self.seen.nbytes)

    @staticmethod
    def of(undistortion: Undistortion) -> PixelMap:
        """Compute it: 0.1 s for 1280x720 pixels."""
        source, target = undistortion.source, undistortion.target
        positions = torch.empty(target.height, target.width, 2)
        seen = torch.ones(target.height, target.width, dtype=torch.bool)
        for top in range(0, target.height, ROWS):
            bottom = min(top + ROWS, target.height)
            y, x = np.mgrid[top:bottom, : target.width].reshape(2, -1) + 0.5
            pixels, inside = undistortion.look(np.stack([x, y], axis=1))
            asked = _asked(pixels, source.width, source.height)
            positions[top:bottom] = torch.from_numpy(asked).view(bottom - top, target.width, 2)
            seen[top:bottom] = torch.from_numpy(inside).view(bottom - top, target.width)
        return PixelMap(positions, seen if undistortion.has_blanks else None)


def _asked(
    pixels: Float64[np.ndarray, "m 2"], width: int, height: int
) -> Float64[np.ndarray, "m 2"]:
    """What to ask torch for to get the colours at pixels; anything outside for nan."""
    beside = np.nan_to_num(pixels, nan=-1.0).clip(-1.0, (width + 1.0, height + 1.0)) - 0.5
    first = np.floor(beside)
    asked = first + ASKED[((beside - first) * STEPS + 0.5).astype(np.int32)] + 0.5
    return 2 * asked / (width, height) - 1
