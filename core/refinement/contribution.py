"""Contributions: what part of the training pictures every row makes up.

The contribution of a splat to a picture is the sum over its pixels of alpha times transmittance.
Papantonakis et al. 2024 ("Reducing the Memory Footprint of 3D Gaussian Splatting") and Fan et al.
2024 (LightGaussian) prune by what is summed over views, Fang and Wang 2024 (Mini-Splatting) draw by
it, and Niemeyer et al. 2024 (RadSplat) prune by the largest value at any pixel of any view.
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
    """Gathers over some steps, between which rows stay as they are.

    Pictures count in parts of their pixels, so that it makes no difference how large they are.
    """

    def __init__(self, num_rows: int, device: torch.device) -> None:
        self._largest = torch.zeros(num_rows, device=device)
        self._total = torch.zeros(num_rows, device=device)
        self._pictures = 0
        self._views: set[int] = set()

    def add(self, context: StepContext, statistics: RenderStatistics) -> None:
        """Take in a batch whose contributions were measured; no synchronisation."""
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
        self._views.update(context.batch.views)

    @property
    def num_views(self) -> int:
        """Different views taken in."""
        return len(self._views)

    @property
    def num_pictures(self) -> int:
        """Pictures taken in, some of the same views."""
        return self._pictures

    @property
    def mean(self) -> Float[Tensor, " n"]:
        """Mean over the pictures, each of which is 1 in all where it is opaque."""
        return self._total / max(self._pictures, 1)

    @property
    def largest(self) -> Float[Tensor, " n"]:
        """The largest of any picture."""
        return self._largest

    def state_dict(self) -> dict[str, Any]:
        """Sums and maxima, and which views they are of."""
        return {
            "largest": self._largest,
            "total": self._total,
            "pictures": self._pictures,
            "views": sorted(self._views),
        }

    @staticmethod
    def restored(state: Mapping[str, Any]) -> Contributions:
        """What ``state_dict`` described, where its tensors are."""
        found = Contributions(0, state["total"].device)
        found._largest, found._total = state["largest"].clone(), state["total"].clone()
        found._pictures, found._views = state["pictures"], set(state["views"])
        return found
