"""StepReports: the reports of logged steps, with the figures of all processes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import torch

from gsfw.core.batch import Batch
from gsfw.core.callback import StepReport, TrainingView
from gsfw.core.context import StepContext
from gsfw.core.datamanager import Views
from gsfw.core.loop.distractors import Distractors
from gsfw.core.loop.forward import RenderedBatch, shared_losses, without_data
from gsfw.core.loop.memory import peak_memory_mb
from gsfw.core.loop.model_handle import ModelHandle
from gsfw.core.loop.stopwatch import Stopwatch
from gsfw.core.loop.training_parts import TrainingParts
from gsfw.core.loop.update import Update
from gsfw.core.method import Method
from gsfw.core.metrics import psnr
from gsfw.core.refiner import Refinement
from gsfw.core.returns import checked_figures


class StepReports:
    """Makes the reports of one run, and counts the edits of rows between them."""

    def __init__(self, views: Views, stopwatch: Stopwatch, handle: ModelHandle | None) -> None:
        """Nothing is counted yet.

        Args:
            views: the training views, at their full size.
            stopwatch: of the run; each report restarts it.
            handle: the model for callbacks; ``None`` where processes share its rows.
        """
        self._names = views.names
        self._widths = [camera.width for camera in views.cameras]
        self._stopwatch, self._handle = stopwatch, handle
        self._refined: Counter[str] = Counter()

    def count(self, edits: Refinement) -> None:
        """Count the edits of a step for the next report."""
        self._refined.update(edits)

    def resolution(self, item: RenderedBatch) -> float:
        """Width of the images of a batch over their full width."""
        batch = item.context.batch
        return batch.cameras.width / self._widths[batch.views[0]]

    def make(
        self, step: int, rendered: list[RenderedBatch], parts: TrainingParts, updates: Update
    ) -> StepReport | None:
        """The report after a step; ``None`` in processes that do not lead.

        All processes of a team call this.

        Args:
            step: number of finished steps.
            rendered: batches of the latest update.
            parts: of the run.
            updates: of the run.
        """
        team = parts.team
        # Processes that share rendering have the same images, and their own rows.
        named = rendered if team.leads or not team.shares_rendering else without_data(rendered)
        own = (shared_losses(named), peak_memory_mb(parts.device))
        losses, memory = map(_summed, zip(*team.gathered(own), strict=True))
        if not team.leads:
            return None
        context = rendered[0].context
        batch = _without_distractors(context, parts.distractors)
        left_out = batch.left_out
        valid = None if batch.valid is None else batch.valid[0]
        step_ms, stage_ms = self._stopwatch.read()
        report = StepReport(
            step=step,
            loss=sum(losses.values()),
            losses=losses,
            psnr=psnr(context.rendered.color[0], context.target[0], valid),
            num_gaussians=len(parts.table),
            learning_rates=parts.optimizer.learning_rates(step - 1),
            step_ms=step_ms,
            stage_ms=stage_ms,
            memory_mb=memory,
            skipped_steps=updates.skipped,
            resolution=self.resolution(rendered[0]),
            refined=dict(self._refined),
            metrics=_own_metrics(parts.method, context),
            view=TrainingView(
                self._names[batch.views[0]],
                context.target[0],
                context.rendered.color[0].detach(),
                None if left_out is None else left_out[0],
            ),
            model=self._handle,
        )
        self._refined.clear()
        return report


@torch.no_grad()
def _own_metrics(method: Method, context: StepContext) -> dict[str, float]:
    """The method's own figures of a step.

    Raises:
        ConfigError: they are no numbers by name; names the method and what it returned.
    """
    source = f"{method.registered_as or type(method).__name__}: step_metrics"
    return checked_figures(source, method.step_metrics(context))


def _without_distractors(context: StepContext, distractors: Distractors | None) -> Batch:
    """The images of a step, also of one that uses whole images: it is reported like the others."""
    batch = context.batch
    if distractors is None or context.step < distractors.start or batch.left_out is not None:
        return batch
    return distractors.without(batch, context.rendered, context.target)


def _summed(parts: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Sums by name."""
    return {name: sum(part.get(name, 0.0) for part in parts) for part in parts for name in part}
