"""Forward: loads the batches of a step and renders them, with their losses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.context import StepContext
from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError
from gsfw.core.loop.evaluation import by_view
from gsfw.core.loop.refined_capture import RefinedCapture
from gsfw.core.loop.training_parts import TrainingParts, TrainingPlan
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import Depth, RenderSettings
from gsfw.core.returns import HOW_TO_TERM, checked_settings, checked_terms
from gsfw.core.team import RenderedPart


@dataclass(frozen=True)
class RenderedBatch:
    """One batch of a step after its forward pass."""

    context: StepContext
    losses: Mapping[str, Tensor]
    """All weighted terms by name."""
    data_losses: tuple[str, ...]
    """Names of the terms that compare with the images."""
    total: Tensor
    """Sum of all terms, times this batch's share of the step."""
    by_rows: Sequence[Mapping[str, Tensor]] = ()
    """The terms of each part of the rows, which do not compare with the images."""

    @property
    def data_loss(self) -> Tensor:
        """Sum of the terms that compare with the images."""
        return reduce(torch.add, [self.losses[name] for name in self.data_losses])


class Forward:
    """The first half of a step: batches -> splats -> render -> decode -> losses."""

    def __init__(self, parts: TrainingParts, plan: TrainingPlan) -> None:
        self._parts, self._plan = parts, plan

    def load(self, views: tuple[int, ...], coming: tuple[int, ...], step: int) -> list[Batch]:
        """The batches of some training views, at the image size of the step, with given poses.

        Args:
            views: the training views.
            coming: views of later steps, which are loaded in the background.
            step: number of the step, counted from 0.
        """
        parts, plan = self._parts, self._plan
        # The views of this step come first: loaders work in the order of the requests.
        data = parts.data.given if isinstance(parts.data, RefinedCapture) else parts.data
        data.prefetch(Split.TRAIN, (*views, *coming))
        alone = (
            parts.team.splits_views
            or parts.shown.depends_on_view
            or parts.refiners.needs_view_gradients(step)
        )
        groups = [(view,) for view in views] if alone else [views]
        batches = [
            batch for group in groups for batch in data.load(Split.TRAIN, group, parts.device)
        ]
        reduced = [plan.resolution.reduce(batch, step) for batch in batches]
        return [parts.corrections.numbered(batch) for batch in reduced]

    def settings(self, step: int, count: int) -> list[RenderSettings]:
        """The settings of each batch of a step, as the method changes them, with a background.

        Args:
            step: number of the step, counted from 0.
            count: number of batches of all processes.
        """
        settings = checked_settings(self._parts.method, self._plan.settings, step)
        return [replace(settings, background=self._background(settings)) for _ in range(count)]

    def render(self, batch: Batch, step: int, share: float, base: RenderSettings) -> RenderedBatch:
        """Run the forward pass of one batch.

        Args:
            batch: images and cameras.
            step: number of the step, counted from 0.
            share: weight of its loss in that of the step.
            base: the settings of the batch (``settings``).
        """
        parts = self._parts
        batch = parts.corrections.refined(batch)
        settings = self._with_refiners(base, step)
        background = settings.background
        assert background is not None
        rendering = parts.render(batch.cameras, settings, batch.time)
        splats = rendering.splats
        bare = replace(base, statistics=frozenset(), contribution_weights=None)

        shown = parts.corrections.expose(rendering.output, batch, background)
        target = batch.target(background)
        if parts.distractors is not None and parts.distractors.are_left_out(step):
            batch = parts.distractors.without(batch, shown, target)

        def render_view(cameras: Cameras, time: Float[Tensor, ""] | None = None) -> RenderOutput:
            return by_view(parts.shown, cameras, lambda seen: parts.render(seen, bare, time).output)

        def contributions(weights: Float[Tensor, "c h w 1"]) -> Float[Tensor, "c m"]:
            return parts.rasterizer.contributions(splats, batch.cameras, weights, settings)

        context = StepContext(
            step=step,
            steps=self._plan.steps,
            batch=batch,
            splats=splats,
            rendered=shown,
            target=target,
            num_rows=len(parts.table),
            share=share,
            extent=parts.data.scene.extent,
            operators=parts.operators,
            render=render_view,
            contributions=contributions,
        )
        return self._with_losses(context, rendering.parts)

    def absent(self, view: int, step: int, share: float) -> StepContext:
        """The context of a view that another process has rendered: without images and splats."""
        parts = self._parts
        nothing: Any = Absent(views=(view,), rows=None)
        return StepContext(
            step=step,
            steps=self._plan.steps,
            batch=nothing,
            splats=nothing,
            rendered=nothing,
            target=nothing,
            num_rows=len(parts.table),
            share=share,
            extent=parts.data.scene.extent,
            operators=parts.operators,
            render=nothing,
            contributions=nothing,
        )

    def _with_losses(self, context: StepContext, rendered: Sequence[RenderedPart]) -> RenderedBatch:
        """The batch with its terms, which are checked: those of plugins have any form.

        Raises:
            ConfigError: the method has no term, or one without gradients; names it.
        """
        parts = self._parts
        method = parts.method.registered_as or type(parts.method).__name__
        data_losses = checked_terms(f"{method}: losses", parts.method.losses(context))
        if not data_losses:
            raise ConfigError(f"{method}: losses returned no term.", HOW_TO_TERM)
        by_rows = [self._regularizers(context, part) for part in rendered]
        losses = dict(data_losses)
        for terms in by_rows:
            for name, value in terms.items():
                losses[name] = losses[name] + value if name in losses else value
        total = reduce(torch.add, losses.values())
        if context.share != 1.0:
            total = total * context.share
        if not total.requires_grad:
            raise ConfigError(
                f"{method}: losses returned {', '.join(data_losses)} without gradients.",
                "Compute them from context.rendered without detach(), item() or no_grad().",
            )
        return RenderedBatch(context, losses, tuple(data_losses), total, by_rows)

    def _regularizers(self, context: StepContext, part: RenderedPart) -> dict[str, Tensor]:
        """The terms of the model and of the refiners for a part of the rows, times its share."""
        parts = self._parts
        seen = replace(
            context,
            splats=part.splats,
            rendered=replace(context.rendered, statistics=part.statistics),
        )
        with part.shown():
            source = f"{type(parts.model).__name__}.regularizers"
            terms = checked_terms(source, parts.model.regularizers(seen))
            terms = {**terms, **parts.refiners.regularizers(seen)}
        if part.share == 1.0:
            return terms
        return {name: value * part.share for name, value in terms.items()}

    def _with_refiners(self, settings: RenderSettings, step: int) -> RenderSettings:
        """The same settings with the statistics and the depth that refiners need."""
        refiners = self._parts.refiners
        depth = refiners.depth(step)
        return replace(
            settings,
            statistics=settings.statistics | refiners.statistics(step),
            depth=settings.depth if depth is Depth.NONE else depth,
        )

    def _background(self, settings: RenderSettings) -> Tensor | None:
        if not self._plan.random_background:
            return settings.background
        return torch.rand(3, generator=self._parts.generator, device=self._parts.device)


class Absent:
    """Stands for the images and splats of a view that another process has rendered."""

    def __init__(self, **known: object) -> None:
        self.__dict__.update(known)

    def __getattr__(self, name: str) -> object:
        raise ConfigError(
            f"a refiner has read {name!r} of a view that another process has rendered.",
            "Train with processes=0. A refiner whose observe() reads images, but no splats, works "
            "with several processes if its reads_images is true.",
        )


def culprits(rendered: list[RenderedBatch]) -> str:
    """A sentence on the loss terms of a step that are not finite; empty if all are."""
    found = {
        name: None  # In order, once each.
        for item in rendered
        for name, value in item.losses.items()
        if not value.isfinite()
    }
    return f" Loss terms that are not finite: {', '.join(found)}." if found else ""


def without_data(rendered: list[RenderedBatch]) -> list[RenderedBatch]:
    """The batches with the terms of the rows alone."""
    return [
        replace(
            item,
            losses={k: v for k, v in item.losses.items() if k not in item.data_losses},
            data_losses=(),
        )
        for item in rendered
    ]


def shared_losses(rendered: list[RenderedBatch]) -> dict[str, float]:
    """Each weighted term of a step, summed over its batches."""
    losses: dict[str, float] = {}
    for item in rendered:
        for name, value in item.losses.items():
            losses[name] = losses.get(name, 0.0) + float(value) * item.context.share
    return losses
