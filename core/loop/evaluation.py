"""Evaluation: the held-out views, rendered and compared under the stated protocol."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.callback import EvaluatedView
from gsfw.core.cameras import Cameras
from gsfw.core.context import ViewContext
from gsfw.core.datamanager import Split, spread
from gsfw.core.loop.baselines import Baselines
from gsfw.core.loop.device import wait_for
from gsfw.core.loop.distractors import KEPT_PSNR
from gsfw.core.loop.findings import Finding
from gsfw.core.loop.training_parts import TrainingParts
from gsfw.core.method import Method
from gsfw.core.metrics import color_corrected, is_hidden, is_one_color, psnr
from gsfw.core.model import PrimitiveModel
from gsfw.core.progress import tracked
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.core.returns import checked_figures, checked_images
from gsfw.core.temporal_metrics.over_time import OverTime, means

FINISHED = sys.maxsize
"""Number of finished steps of a run that is not trained on."""


@dataclass(frozen=True)
class Evaluation:
    """Figures of the held-out views."""

    views: tuple[str, ...]
    """Names of the compared views."""
    per_view: tuple[Mapping[str, float], ...]
    """Each metric by name, view by view, in the order of ``views``."""
    render_ms: float
    """Median wall-clock time to render one view, in milliseconds."""
    means: Mapping[str, float] = field(default_factory=dict)
    """Mean of each metric over the views; empty when there are none."""
    over_time: tuple[Mapping[str, Any], ...] = ()
    """Means of the figures at each time, in order of time; empty for a static capture."""
    notes: Mapping[str, str] = field(default_factory=dict)
    """Protocol of the figures over time, or the cause why there are none; empty if static."""
    held_out: int = 0
    """Views of the split; more than ``views`` where a sample was compared, or where masks hide
    some; 0: as many."""

    one_color: int = 0
    """Number of views whose render is (nearly) one colour although the image is not."""
    searched: int = 0
    """Number of views that were searched for large things that the model does not have; 0 in moving
    scenes, and if distractors are left out."""
    contradicted: tuple[str, ...] = ()
    """Names of the searched views that show such a thing: a person, or a car."""
    baselines: Mapping[str, Any] = field(default_factory=dict)
    """PSNR of images that need no model, and their definitions; empty if not measured."""
    training_psnr: float | None = None
    """Mean PSNR of some training views, in dB; ``None`` if not measured."""
    findings: tuple[Finding, ...] | None = None
    """Signs that the result is not sound; ``None`` if not judged."""

    @property
    def count(self) -> str:
        """Number of compared views, of all where they are a sample: "30 of 200"."""
        number = len(self.views)
        return f"{number} of {self.held_out}" if number < self.held_out else str(number)

    def document(self) -> dict[str, Any]:
        """Plain data for result files."""
        views = [{"name": n, **m} for n, m in zip(self.views, self.per_view, strict=True)]
        figures = {**self.means, "render_ms": self.render_ms, **self.time_document()}
        return {**figures, **self.verdict_document(), "per_view": views}

    def time_document(self) -> dict[str, Any]:
        """Figures over time, for result files; empty for a static capture."""
        if not self.notes:
            return {}
        return {**self.notes, "over_time": [dict(point) for point in self.over_time]}

    def verdict_document(self) -> dict[str, Any]:
        """Baselines and findings, for result files; empty if they were not measured."""
        found: dict[str, Any] = {}
        if self.baselines:
            found["baselines"] = dict(self.baselines)
        if self.training_psnr is not None:
            found["training_psnr"] = self.training_psnr
        if self.findings is not None:
            found["findings"] = [finding.document() for finding in self.findings]
        return found


@torch.no_grad()
def render_model(
    model: PrimitiveModel,
    rasterizer: Rasterizer,
    cameras: Cameras,
    settings: RenderSettings,
    time: Float[Tensor, ""] | None = None,
) -> RenderOutput:
    """Render a model at ``time``, without gradients; see ``by_view`` for several cameras."""

    def render(seen: Cameras) -> RenderOutput:
        return model.decode(rasterizer.render(model.splats(time, seen), seen, settings), seen)

    return by_view(model, cameras, render)


def by_view(
    model: PrimitiveModel, cameras: Cameras, render: Callable[[Cameras], RenderOutput]
) -> RenderOutput:
    """Render all cameras at once, or one by one if the splats of the model depend on the view.

    Statistics are of no splats in the second case: each camera has others.
    """
    if not model.depends_on_view or len(cameras) == 1:
        return render(cameras)
    outputs = [render(cameras.select([index])) for index in range(len(cameras))]
    bare = [one.statistics.map(lambda values: values[:, :0]) for one in outputs]
    pairs = zip(outputs, bare, strict=True)
    return RenderOutput.cat([replace(output, statistics=none) for output, none in pairs])


@torch.no_grad()
def evaluate(
    parts: TrainingParts,
    settings: RenderSettings,
    split: Split = Split.EVAL,
    on_view: Callable[[EvaluatedView], None] | None = None,
    method: Method | None = None,
    baselines: Baselines | None = None,
    most: int = 0,
    step: int = FINISHED,
) -> Evaluation:
    """Render and compare the views of a split, one at a time; not those without a valid pixel.

    ``on_view`` is called after each view. A ``method`` adds its own metrics and images.
    ``baselines`` are those of the same split. With ``most`` above 0 at most so many views are
    compared, evenly spread. ``step`` is the number of finished steps.
    """
    assert settings.background is not None
    data, metrics, device = parts.data, parts.metrics, parts.device
    views = data.views(split)
    watch = None
    if data.scene.is_dynamic and views.times:
        watch = OverTime(data, split, settings.background, device, metrics)
    comparison = _Comparison(parts, watch, baselines, method, settings.background, split, step)
    order = spread(range(len(views)) if watch is None else watch.order(), most)
    per_view: dict[int, Mapping[str, float]] = {}
    durations: list[float] = []
    for place, index in enumerate(tracked(order, "evaluating held-out views", len(order))):
        (batch,) = data.load(split, [index], device)
        if is_hidden(batch.valid):
            continue
        wait_for(device)  # The clock is the host's, and a GPU runs asynchronously.
        started = time.perf_counter()
        output = parts.render(batch.cameras, settings, batch.time).output
        wait_for(device)
        durations.append(1e3 * (time.perf_counter() - started))
        # Not before the render, whose time would include that of the threads.
        data.prefetch(split, order[place + 1 : place + 2])
        target = batch.target(settings.background)
        context = ViewContext(batch, output, target, data.scene.extent)
        per_view[index] = comparison.compare(index, context)
        if on_view is not None:
            images = {} if method is None else own_images(method, context)
            target, shown = context.target[0], output.color[0]
            on_view(EvaluatedView(views.names[index], per_view[index], target, shown, images))
    middle = sorted(durations)[len(durations) // 2] if durations else 0.0
    return comparison.evaluation(views.names, per_view, middle)


@torch.no_grad()
def own_images(method: Method, context: ViewContext) -> Mapping[str, Float[Tensor, "h w 3"]]:
    """The method's own images of a view, by name.

    Raises:
        ConfigError: they are of another kind or shape; names the method and what it returned.
    """
    source = f"{method.registered_as or type(method).__name__}: view_images"
    return checked_images(source, method.view_images(context))


class _Comparison:
    """Compares the renders of one evaluation with their images, view by view."""

    def __init__(
        self,
        parts: TrainingParts,
        watch: OverTime | None,
        baselines: Baselines | None,
        method: Method | None,
        background: Float[Tensor, " 3"],
        split: Split,
        step: int,
    ) -> None:
        self._background, self._split, self._step = background, split, step
        self._is_sought = parts.seeks_contradictions(split)
        self._parts, self._metrics, self._watch = parts, parts.metrics, watch
        self._baselines, self._method = baselines, method
        self._contradicted: list[int] = []
        self._one_color = 0

    def compare(self, index: int, context: ViewContext) -> dict[str, float]:
        """Figures of one view."""
        image, target = context.rendered.color[0], context.target[0]
        valid = None if context.batch.valid is None else context.batch.valid[0]
        figures = {name: metric(image, target, valid) for name, metric in self._metrics.items()}
        moving = None if self._watch is None else self._watch.moving(index)
        if self._watch is not None:
            figures |= self._watch.compare(index, image, target, valid, moving)
        seen = context.batch, context.rendered, self._background
        if self._parts.leaves_out(self._step):
            kept = self._parts.compared(*seen, self._step, self._split).valid
            inside = None if kept is None else kept[0]
            is_lit = self._parts.corrections.exposures is None
            lit = image if is_lit else color_corrected(image, target, inside)
            if not is_hidden(inside):
                figures[KEPT_PSNR] = psnr(lit, target, inside)
        if self._is_sought and self._parts.contradicts(*seen, self._split):
            self._contradicted.append(index)
        if self._baselines is not None:
            counted = moving if moving is None or valid is None else moving & valid
            self._baselines.compare(index, target, valid, counted)
        self._one_color += is_one_color(image, target, valid)
        return figures | self._own_figures(context)

    def _own_figures(self, context: ViewContext) -> dict[str, float]:
        if self._method is None:
            return {}
        source = f"{self._method.registered_as or type(self._method).__name__}: view_metrics"
        return checked_figures(source, self._method.view_metrics(context))

    def evaluation(
        self, names: Sequence[str], per_view: Mapping[int, Mapping[str, float]], render_ms: float
    ) -> Evaluation:
        """The figures of all compared views together, in the order of the views.

        Args:
            names: names of all views of the split.
            per_view: figures of the compared ones, by index.
            render_ms: median time to render one.
        """
        watch, baselines = self._watch, self._baselines
        chosen = sorted(per_view)
        figures = tuple(per_view[index] for index in chosen)
        return Evaluation(
            tuple(names[index] for index in chosen),
            figures,
            render_ms,
            means=means(figures) | ({} if watch is None else dict(watch.figures())),
            over_time=() if watch is None else watch.curve(per_view),
            notes={} if watch is None else watch.notes(),
            held_out=len(names),
            one_color=self._one_color,
            searched=len(chosen) if self._is_sought else 0,
            contradicted=tuple(names[index] for index in sorted(self._contradicted)),
            baselines={} if baselines is None else baselines.document(),
        )
