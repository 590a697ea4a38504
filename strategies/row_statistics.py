"""RowStatistics: what the views since the last refinement have seen of every row."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor


class RowStatistics:
    """Sums over the views in which a row was visible; every view weighs the same."""

    def __init__(self, num_rows: int, device: torch.device) -> None:
        self._gradient = torch.zeros(num_rows, device=device)
        self._views = torch.zeros(num_rows, device=device)
        self._radius = torch.zeros(num_rows, device=device)

    def add(
        self,
        gradient: Float[Tensor, "c m"],
        radii: Float[Tensor, "c m"],
        visible: Bool[Tensor, "c m"],
        rows: Int[Tensor, " m"] | None = None,
    ) -> None:
        """Take in ``c`` views of ``m`` splats; no synchronisation.

        Args:
            gradient: of each view's own loss.
            radii: in pixels; 0 where invisible.
            visible: which splats each view has seen.
            rows: the row of each splat; ``None`` when splat i is row i.
        """
        seen = visible.to(self._views.dtype)
        total, views = (gradient * seen).sum(0).to(self._gradient), seen.sum(0)
        largest = torch.where(visible, radii, 0.0).amax(0).to(self._radius)
        if rows is None:  # Several times faster than by index.
            self._gradient += total
            self._views += views
            self._radius = torch.maximum(self._radius, largest)
            return
        self._gradient.index_add_(0, rows, total)
        self._views.index_add_(0, rows, views)
        self._radius[rows] = torch.maximum(self._radius[rows], largest)

    @property
    def mean_gradient(self) -> Float[Tensor, " n"]:
        """Mean over the views that saw the row; 0 where none did."""
        return self._gradient / self._views.clamp_min(1.0)

    @property
    def largest_radius(self) -> Float[Tensor, " n"]:
        """In pixels; 0 where no view saw the row."""
        return self._radius

    def state_dict(self) -> dict[str, Tensor]:
        """The sums."""
        return {"gradient": self._gradient, "views": self._views, "radius": self._radius}

    @staticmethod
    def restored(state: Mapping[str, Tensor], device: torch.device) -> RowStatistics:
        """What ``state_dict`` described."""
        statistics = RowStatistics(0, device)
        statistics._gradient = state["gradient"].to(device).clone()
        statistics._views = state["views"].to(device).clone()
        statistics._radius = state["radius"].to(device).clone()
        return statistics
