"""Evaluation: the held-out views, drawn and compared under the stated protocol."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.callback import EvaluatedView
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.device import wait_for
from gsfw.core.metrics import Metric
from gsfw.core.model import PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings


@dataclass(frozen=True)
class Evaluation:
    """Figures of the held-out views."""

    views: tuple[str, ...]
    per_view: tuple[Mapping[str, float], ...]
    render_ms: float
    """Median wall-clock time to draw one view, in milliseconds."""
    means: Mapping[str, float] = field(default_factory=dict)
    """Mean of each metric over the views; empty when there are none."""

    def document(self) -> dict[str, Any]:
        """Plain data for result files."""
        views = [{"name": n, **m} for n, m in zip(self.views, self.per_view, strict=True)]
        return {**self.means, "render_ms": self.render_ms, "per_view": views}


@torch.no_grad()
def draw(
    model: PrimitiveModel,
    rasterizer: Rasterizer,
    cameras: Cameras,
    settings: RenderSettings,
    time: Float[Tensor, ""] | None = None,
) -> RenderOutput:
    """Draw a model as it is at ``time``, without gradients."""
    cameras = model.cameras(cameras)
    output = rasterizer.render(model.splats(time), cameras, model.settings(settings))
    return model.decode(output, cameras)


def evaluate(
    model: PrimitiveModel,
    rasterizer: Rasterizer,
    data: DataManager,
    metrics: Mapping[str, Metric],
    settings: RenderSettings,
    device: torch.device,
    split: Split = Split.EVAL,
    on_view: Callable[[EvaluatedView], None] | None = None,
) -> Evaluation:
    """Draw and compare every view of a split, one at a time."""
    views = data.views(split)
    per_view: list[Mapping[str, float]] = []
    durations: list[float] = []
    for index, name in enumerate(views.names):
        data.prefetch(split, range(index + 1, min(index + 3, len(views))))
        (batch,) = data.load(split, [index], device)
        wait_for(device)  # The clock is the host's, and a GPU works behind its back.
        started = time.perf_counter()
        output = draw(model, rasterizer, batch.cameras, settings, batch.time)
        wait_for(device)
        durations.append(1e3 * (time.perf_counter() - started))
        figures, target = _compare(output, batch, metrics, settings)
        per_view.append(figures)
        if on_view is not None:
            on_view(EvaluatedView(name, figures, target, output.color[0]))
    means = {
        name: sum(figures[name] for figures in per_view) / len(per_view)
        for name in metrics
        if per_view
    }
    middle = sorted(durations)[len(durations) // 2] if durations else 0.0
    return Evaluation(views.names, tuple(per_view), middle, means)


@torch.no_grad()
def _compare(
    output: RenderOutput, batch: Batch, metrics: Mapping[str, Metric], settings: RenderSettings
) -> tuple[dict[str, float], Tensor]:
    assert settings.background is not None
    target = batch.target(settings.background)[0]
    valid = None if batch.valid is None else batch.valid[0]
    figures = {name: metric(output.color[0], target, valid) for name, metric in metrics.items()}
    return figures, target
