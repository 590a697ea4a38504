"""Evaluation: the held-out views, rendered and compared under the stated protocol."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.callback import EvaluatedView
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.loop.device import wait_for
from gsfw.core.method import Method
from gsfw.core.metrics import Metric
from gsfw.core.model import PrimitiveModel
from gsfw.core.progress import tracked
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.core.temporal_metrics.over_time import OverTime, means


@dataclass(frozen=True)
class Evaluation:
    """Figures of the held-out views."""

    views: tuple[str, ...]
    """Names of the compared views."""
    per_view: tuple[Mapping[str, float], ...]
    render_ms: float
    """Median wall-clock time to render one view, in milliseconds."""
    means: Mapping[str, float] = field(default_factory=dict)
    """Mean of each metric over the views; empty when there are none."""
    over_time: tuple[Mapping[str, Any], ...] = ()
    """Means of the figures at each time, in order of time; empty for a static capture."""
    notes: Mapping[str, str] = field(default_factory=dict)
    """Protocol of the figures over time, or the cause why there are none; empty if static."""
    held_out: int = 0
    """Views of the split; more than ``views`` where a sample was compared; 0: as many."""

    @property
    def count(self) -> str:
        """Number of compared views, of all where they are a sample: "30 of 200"."""
        number = len(self.views)
        return f"{number} of {self.held_out}" if number < self.held_out else str(number)

    def document(self) -> dict[str, Any]:
        """Plain data for result files."""
        views = [{"name": n, **m} for n, m in zip(self.views, self.per_view, strict=True)]
        figures = {**self.means, "render_ms": self.render_ms, **self.time_document()}
        return {**figures, "per_view": views}

    def time_document(self) -> dict[str, Any]:
        """Figures over time, for result files; empty for a static capture."""
        if not self.notes:
            return {}
        return {**self.notes, "over_time": [dict(point) for point in self.over_time]}


@torch.no_grad()
def render_model(
    model: PrimitiveModel,
    rasterizer: Rasterizer,
    cameras: Cameras,
    settings: RenderSettings,
    time: Float[Tensor, ""] | None = None,
) -> RenderOutput:
    """Render a model at ``time``, without gradients."""
    output = rasterizer.render(model.splats(time, cameras), cameras, settings)
    return model.decode(output, cameras)


@torch.no_grad()
def evaluate(
    model: PrimitiveModel,
    rasterizer: Rasterizer,
    data: DataManager,
    metrics: Mapping[str, Metric],
    settings: RenderSettings,
    device: torch.device,
    split: Split = Split.EVAL,
    on_view: Callable[[EvaluatedView], None] | None = None,
    method: Method | None = None,
    most: int = 0,
) -> Evaluation:
    """Render and compare the views of a split, one at a time.

    ``on_view`` is called after each view. A ``method`` adds its own metrics and images. With
    ``most`` above 0 at most so many views are compared, evenly spread.
    """
    assert settings.background is not None
    views = data.views(split)
    watch = None
    if data.scene.is_dynamic and views.times:
        watch = OverTime(data, split, settings.background, device, metrics)
    order = spread(range(len(views)) if watch is None else watch.order(), most)
    per_view: dict[int, Mapping[str, float]] = {}
    durations: list[float] = []
    for place, index in enumerate(tracked(order, "evaluating held-out views", len(order))):
        data.prefetch(split, order[place + 1 : place + 3])
        (batch,) = data.load(split, [index], device)
        wait_for(device)  # The clock is the host's, and a GPU runs asynchronously.
        started = time.perf_counter()
        output = render_model(model, rasterizer, batch.cameras, settings, batch.time)
        wait_for(device)
        durations.append(1e3 * (time.perf_counter() - started))
        image, target = output.color[0], batch.target(settings.background)[0]
        valid = None if batch.valid is None else batch.valid[0]
        figures = {name: metric(image, target, valid) for name, metric in metrics.items()}
        if watch is not None:
            figures |= watch.compare(index, image, target, valid)
        figures |= {} if method is None else method.view_metrics(batch, output)
        per_view[index] = figures
        if on_view is not None:
            images = {} if method is None else method.view_images(batch, output)
            on_view(EvaluatedView(views.names[index], figures, target, image, images))
    middle = sorted(durations)[len(durations) // 2] if durations else 0.0
    per_view = dict(sorted(per_view.items()))
    names, found = tuple(views.names[index] for index in per_view), tuple(per_view.values())
    averages = means(found) | ({} if watch is None else dict(watch.figures()))
    curve = () if watch is None else watch.curve(per_view)
    notes = {} if watch is None else watch.notes()
    return Evaluation(names, found, middle, averages, curve, notes, len(views))


def spread(order: Sequence[int], most: int) -> Sequence[int]:
    """At most ``most`` items, evenly spread and in the same order; 0: all."""
    if most <= 0 or len(order) <= most:
        return order
    return [order[place * len(order) // most] for place in range(most)]
