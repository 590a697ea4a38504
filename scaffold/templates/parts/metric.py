"""Metric my-part: the mean absolute difference of colours."""

from __future__ import annotations

from gsfw.api import Metric
from torch import Tensor


class MyPart(Metric):
    """Mean absolute difference of colours in [0, 1]; 0 for equal images, lower is better."""

    def __call__(self, rendered: Tensor, target: Tensor, valid: Tensor | None) -> float:
        """Compare one image.

        Args:
            rendered: the render, [h, w, 3]; may exceed [0, 1].
            target: the photo, [h, w, 3].
            valid: true where a pixel counts, [h, w, 1]; ``None`` if all do.
        """
        difference = (rendered.clamp(0, 1) - target.clamp(0, 1)).abs().double()
        if valid is None:
            return float(difference.mean())
        counted = difference[valid[..., 0]]
        return float(counted.mean()) if len(counted) else 0.0
