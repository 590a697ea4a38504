"""Contributions: the fraction of the training images that each row contributes.

The contribution of a splat to an image is the sum over its pixels of alpha times transmittance.
Papantonakis et al. 2024 ("Reducing the Memory Footprint of 3D Gaussian Splatting") and Fan et al.
2024 (LightGaussian) prune by its sum over views, Fang and Wang 2024 (Mini-Splatting) sample by it,
and Niemeyer et al. 2024 (RadSplat) prune by the largest value at any pixel of any view.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.render_output import RenderStatistics


class Contributions:
    """Gathers contributions over some steps, between which rows do not change.

    Contributions are divided by the number of pixels, so that the image size has no effect.
    """

    def __init__(self, num_rows: int, device: torch.device) -> None:
        self._largest = torch.zeros(num_rows, device=device)
        self._total = torch.zeros(num_rows, device=device)
        self._pictures = 0
        self._counted = torch.zeros((), device=device)
        """Images of steps that have changed something."""
        self._views: set[int] = set()

    def add(self, context: StepContext, statistics: RenderStatistics) -> None:
        """Add a batch with measured contributions; no synchronisation."""
        assert statistics.contribution is not None
        cameras, rows = context.batch.cameras, context.splats.rows
        parts = statistics.contribution.to(self._total) / (cameras.width * cameras.height)
        total, largest = parts.sum(0), parts.amax(0)
        if rows is None:
            self._total += total
            self._largest = torch.maximum(self._largest, largest)
        else:
            self._total.index_add_(0, rows, total)
            self._largest[rows] = torch.maximum(self._largest[rows], largest)
        self._pictures += len(parts)
        self._counted += statistics.visible.any(1).sum()
        self._views.update(context.batch.views)

    @property
    def num_views(self) -> int:
        """Number of distinct views."""
        return len(self._views)

    @property
    def num_images(self) -> int:
        """Number of images, some of the same views."""
        return self._pictures

    @property
    def mean(self) -> Float[Tensor, " n"]:
        """Mean over the images; the sum over all rows is 1 for an opaque image."""
        return self._total / self._counted.clamp_min(1)

    @property
    def largest(self) -> Float[Tensor, " n"]:
        """The largest contribution to any image."""
        return self._largest

    def state_dict(self) -> dict[str, Any]:
        """Sums and maxima, and their views."""
        return {
            "largest": self._largest,
            "total": self._total,
            "pictures": self._pictures,
            "counted": self._counted,
            "views": sorted(self._views),
        }

    @staticmethod
    def restored(state: Mapping[str, Any]) -> Contributions:
        """Restore the contributions that ``state_dict`` returned."""
        found = Contributions(0, state["total"].device)
        found._largest, found._total = state["largest"].clone(), state["total"].clone()
        # Checkpoints of before November 2026 have no such number.
        found._counted += state.get("counted", state["pictures"])
        found._pictures, found._views = state["pictures"], set(state["views"])
        return found
