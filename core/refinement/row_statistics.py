"""RowStatistics: screen gradients and radii of every row, summed over views."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.render_output import RenderStatistics


class RowStatistics:
    """Sums over the views in which a row was visible; every view has the same weight."""

    def __init__(self, num_rows: int, device: torch.device) -> None:
        self._gradient = torch.zeros(num_rows, device=device)
        self._views = torch.zeros(num_rows, device=device)
        self._radius = torch.zeros(num_rows, device=device)
        self._time_gradient: Tensor | None = None

    def add(
        self,
        context: StepContext,
        statistics: RenderStatistics,
        gradient: Float[Tensor, "c m"],
    ) -> None:
        """Add the ``c`` views of a batch, which rendered ``m`` splats; no synchronisation.

        The loss of a step is the mean over its views. Each view counts with the gradient of its
        own loss, as if it were the only one of its step.

        Args:
            context: context of the batch.
            statistics: statistics of the batch, for visibility and radii.
            gradient: gradient of the step's loss, per view and splat.
        """
        views_in_step = len(context.batch.views) / context.share
        if views_in_step != 1.0:
            gradient = gradient * views_in_step
        self.add_views(gradient, statistics.radii, statistics.visible, context.splats.rows)

    def add_views(
        self,
        gradient: Float[Tensor, "c m"],
        radii: Float[Tensor, "c m"],
        visible: Bool[Tensor, "c m"],
        rows: Int[Tensor, " m"] | None = None,
    ) -> None:
        """Add ``c`` views of ``m`` splats; no synchronisation.

        Args:
            gradient: gradient of each view's own loss.
            radii: in pixels; 0 where invisible.
            visible: visible splats of each view.
            rows: the row of each splat; ``None`` when splat i is row i.
        """
        total = (gradient * visible).sum(0).to(self._gradient)
        views = visible.sum(0, dtype=self._views.dtype)
        largest = (radii * visible).amax(0).to(self._radius)
        if rows is None:  # Several times faster than by index.
            self._gradient += total
            self._views += views
            self._radius = torch.maximum(self._radius, largest)
            return
        self._gradient.index_add_(0, rows, total)
        self._views.index_add_(0, rows, views)
        self._radius[rows] = torch.maximum(self._radius[rows], largest)

    def add_time_gradient(
        self,
        gradient: Float[Tensor, " n"],
        views: int,
        observed: Bool[Tensor, ""],
    ) -> None:
        """Add the gradient of a step with respect to temporal centres; no synchronisation.

        The gradient is that of the whole step, whose loss is the mean over its views. Gradients of
        single views are not known. Each of the step's batches adds its part, for all rows:
        together they add the gradient times the views of the step, which ``mean_time_gradient``
        divides by the number of views that saw the row.

        Args:
            gradient: gradient of the step's loss, for every row of the model.
            views: number of views of the batch.
            observed: false to add zeros, as for a step that was not finite.
        """
        added = torch.where(observed, gradient * views, 0.0).to(self._gradient)
        self._time_gradient = added if self._time_gradient is None else self._time_gradient + added

    @property
    def mean_gradient(self) -> Float[Tensor, " n"]:
        """Mean over the views that saw the row; 0 if none did."""
        return self._gradient / self._views.clamp_min(1.0)

    @property
    def mean_time_gradient(self) -> Float[Tensor, " n"] | None:
        """Mean over the views that saw the row; ``None`` if no gradient was added."""
        if self._time_gradient is None:
            return None
        return self._time_gradient / self._views.clamp_min(1.0)

    @property
    def largest_radius(self) -> Float[Tensor, " n"]:
        """Largest radius in pixels; 0 if no view saw the row."""
        return self._radius

    def taken(self, rows: Int[Tensor, " r"]) -> RowStatistics:
        """The statistics of some rows, for a model whose rows are copies of these."""
        state = {name: values.index_select(0, rows) for name, values in self.state_dict().items()}
        return RowStatistics.restored(state, rows.device)

    def state_dict(self) -> dict[str, Tensor]:
        """The sums; that of time gradients only if there is one."""
        sums = {"gradient": self._gradient, "views": self._views, "radius": self._radius}
        if self._time_gradient is not None:
            sums["time_gradient"] = self._time_gradient
        return sums

    @staticmethod
    def restored(state: Mapping[str, Tensor], device: torch.device) -> RowStatistics:
        """The statistics that ``state_dict`` returned."""
        sums = {name: values.to(device).clone() for name, values in state.items()}
        statistics = RowStatistics(0, device)
        statistics._gradient, statistics._views = sums["gradient"], sums["views"]
        statistics._radius = sums["radius"]
        statistics._time_gradient = sums.get("time_gradient")
        return statistics
