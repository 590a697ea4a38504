"""OverTime: the figures of data with times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.datamanager import DataManager, Split
from gsfw.core.metrics import Metric
from gsfw.core.temporal_metrics.flicker import Flicker, Still
from gsfw.core.temporal_metrics.moving_region import MIN_DEVIATION, MovingRegions, camera_key

MOVING = "moving_"
"""Prefix of the names of metrics over moving pixels only."""

TIME_PROTOCOL = {
    "moving_region": "the data set's masks where it has some; else pixels whose standard deviation "
    f"over all images of the same fixed camera exceeds {MIN_DEVIATION} in some channel",
    "moving_metrics": "per image over moving pixels, with all others at 0 in both images; images "
    "where nothing moves are left out of the mean",
    "flicker": "mean absolute difference between drawn and true change from one held-out time of "
    "a fixed camera to its next, over pixels that move in neither (static) or in some (moving)",
}
"""Measurement protocol; written into every result file of data with times."""


class OverTime:
    """Gathers the figures over time of one evaluation."""

    def __init__(
        self,
        data: DataManager,
        split: Split,
        background: Float[Tensor, " 3"],
        device: torch.device,
        metrics: Mapping[str, Metric],
    ) -> None:
        """Decodes nothing; the views of ``split`` have times."""
        self._views = data.views(split)
        self._times = self._views.times or ()
        self._range = data.scene.time_range or (0.0, 1.0)
        self._regions = MovingRegions(data, split, background, device)
        self._metrics = metrics
        self._flicker = Flicker()

    def order(self) -> list[int]:
        """Views camera by camera, each in order of time; cameras in order of first appearance."""
        groups: dict[object, list[int]] = {}
        for index, camera in enumerate(self._views.cameras):
            groups.setdefault(camera_key(camera), []).append(index)
        return [
            index
            for group in groups.values()
            for index in sorted(group, key=lambda i: self._times[i])
        ]

    def moving(self, index: int) -> Bool[Tensor, "h w 1"] | None:
        """The moving pixels of one view; ``None`` if unknown. Call it once for each view."""
        return self._regions.find(index).mask

    def compare(
        self,
        index: int,
        rendered: Float[Tensor, "h w 3"],
        target: Float[Tensor, "h w 3"],
        valid: Bool[Tensor, "h w 1"] | None,
        moving: Bool[Tensor, "h w 1"] | None,
    ) -> dict[str, float]:
        """Figures of one view's moving pixels; none if there are no such pixels, or if unknown."""
        if moving is None:
            return {}
        camera = camera_key(self._views.cameras[index])
        self._flicker.add(Still(camera, self._times[index], rendered, target, moving, valid))
        counted = moving if valid is None else moving & valid
        if not bool(counted.any()):
            return {}
        return {
            f"{MOVING}{name}": metric(rendered, target, counted)
            for name, metric in self._metrics.items()
        }

    def figures(self) -> Mapping[str, float]:
        """Temporal stability, if a held-out camera shows several times."""
        return self._flicker.figures()

    def notes(self) -> dict[str, str]:
        """Source of the moving region, and the definition of the flicker means."""
        return {"moving_region": self._regions.sources(), "flicker": self._flicker.note()}

    def curve(self, per_view: Mapping[int, Mapping[str, float]]) -> tuple[dict[str, Any], ...]:
        """The means of the figures at each time, in order of time; of the views that have some."""
        first, last = self._range
        points = []
        for time in sorted({self._times[index] for index in per_view}):
            views = [view for index, view in per_view.items() if self._times[index] == time]
            point = {"time": time, "data_time": first + time * (last - first), "views": len(views)}
            points.append({**point, **means(views)})
        return tuple(points)


def means(views: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """The mean of each figure over the views that have it."""
    names = dict.fromkeys(name for view in views for name in view)
    found = {name: [view[name] for view in views if name in view] for name in names}
    return {name: sum(values) / len(values) for name, values in found.items()}
