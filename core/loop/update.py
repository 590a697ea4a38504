"""Update: renders the views of one step, and updates all parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from traceback import clear_frames
from typing import Any

import torch
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.datamanager import Split
from gsfw.core.loop.forward import Forward, RenderedBatch
from gsfw.core.loop.recording import Recorder
from gsfw.core.loop.step_graphs import Outcome, StepGraphs
from gsfw.core.loop.step_inputs import StepInputs
from gsfw.core.loop.stopwatch import Stopwatch
from gsfw.core.loop.training_parts import TrainingParts, TrainingPlan
from gsfw.core.sampler import Sampler


class Update:
    """Batches -> splats -> render -> decode -> losses -> backward -> step -> observe."""

    def __init__(
        self, parts: TrainingParts, clock: Stopwatch, recorder: Recorder | None = None
    ) -> None:
        self._parts, self._clock = parts, clock
        self._graphs = StepGraphs(parts, recorder)
        self.is_underway = False
        """True from the first change of a parameter on, until the caller has ended the step."""
        self._times = parts.data.views(Split.TRAIN).times
        self._skipped = torch.zeros((), dtype=torch.int64, device=parts.device)
        self._skipped_in_a_row = torch.zeros_like(self._skipped)

    def working(self) -> AbstractContextManager[None]:
        """The context of all steps of a run."""
        return self._graphs.working()

    @property
    def idle_memory(self) -> int:
        """Bytes of a GPU that only recorded steps can use."""
        return self._graphs.idle_memory

    def give_up(self) -> None:
        """Free the gradients of an unfinished step, and all recorded steps."""
        self._parts.optimizer.zero_gradients()
        self._graphs.drop()

    @property
    def skipped(self) -> int:
        """Number of updates that were skipped, as they were not finite; waits for a GPU."""
        return int(self._skipped)

    @property
    def skipped_in_a_row(self) -> int:
        """Number of them since the latest update that was not skipped; waits for a GPU."""
        return int(self._skipped_in_a_row)

    def run(
        self, plan: TrainingPlan, views: tuple[int, ...], coming: tuple[int, ...], step: int
    ) -> list[RenderedBatch]:
        """Render the views of a step, and update all parameters.

        Args:
            plan: schedule of the run.
            views: the training views of the step.
            coming: views of later steps, which are loaded in the background.
            step: number of the step, counted from 0.

        Returns:
            The batches that this process has rendered.
        """
        parts, clock = self._parts, self._clock
        forward = Forward(parts, plan)
        with clock.stage("load"):
            batches = forward.load(parts.team.own(views), coming, step)
        parts.model.train()
        try:
            parts.method.prepare(step, parts.model, parts.optimizer, self._time_of(views[0]))
            # Every process draws the backgrounds of all batches: their generators stay alike.
            count = len(views) if parts.team.splits_views else len(batches)
            settings = forward.settings(step, count)
            outcome = self._outcome(forward, StepInputs(batches, settings), views, step)
        finally:
            parts.model.eval()
        with clock.stage("refine"):
            self._observe(forward, outcome, views, step)
            parts.optimizer.zero_gradients()
        return outcome.rendered

    def _outcome(
        self, forward: Forward, inputs: StepInputs, views: tuple[int, ...], step: int
    ) -> Outcome:
        """Render the batches of this process and update all parameters, by a graph if possible."""

        def work(inputs: StepInputs, step: int) -> Outcome:
            return self._worked(forward, inputs, views, step)

        outcome = None
        try:
            outcome = self._graphs.run(inputs, step, work)
        except torch.OutOfMemoryError as error:
            if self.is_underway:
                raise
            clear_frames(error.__traceback__)  # They hold the images of this attempt.
            full = error
        if outcome is None:
            self._parts.optimizer.zero_gradients()
            if not self._graphs.drop():
                raise full
            outcome = work(inputs, step)
        self.is_underway = True  # A replay changes parameters without passing through ``work``.
        return outcome

    def _worked(
        self, forward: Forward, inputs: StepInputs, views: tuple[int, ...], step: int
    ) -> Outcome:
        """Render the batches of this process, and update all parameters."""
        parts, clock = self._parts, self._clock
        self.is_underway = False  # A recording before may have failed.
        rendered = self._rendered(forward, inputs, views, step)
        with clock.stage("optimize"):
            finite = self._complete(rendered)
            visible = self._visible(rendered) if parts.optimizer.sparse else None
            self.is_underway = inputs.rates is None  # Else the step is recorded and not run.
            parts.optimizer.step(step, finite, visible, inputs.rates)
            parts.model.project_()
            parts.corrections.project_()
        return Outcome(rendered, finite)

    def _rendered(
        self, forward: Forward, inputs: StepInputs, views: tuple[int, ...], step: int
    ) -> list[RenderedBatch]:
        """Run the forward and the backward pass of all batches of this process."""
        parts, clock = self._parts, self._clock
        rendered: list[RenderedBatch] = []
        for place, batch in parts.team.rounds(inputs.batches, views):
            item = None
            if batch is not None:
                with clock.stage("render"):
                    share = len(batch.views) / len(views)
                    item = forward.render(batch, step, share, inputs.settings[place])
                    parts.refiners.before_backward(item.context, parts.model)
                rendered.append(item)
            with clock.stage("backward"):
                parts.team.backward(item, parts.optimizer)
        return rendered

    def _complete(self, rendered: Sequence[RenderedBatch]) -> Tensor:
        """Complete the gradients; return whether they and the losses are finite."""
        parts = self._parts
        losses = parts.team.finish(rendered, parts.optimizer)
        finite = parts.operators.all_finite([*losses, *parts.optimizer.gradients()])
        finite, skipped = self._graphs.fitting(parts.team.agreed(finite))
        self._skipped += skipped
        self._skipped_in_a_row.add_(1).mul_(skipped)
        return finite

    def _visible(self, rendered: Sequence[RenderedBatch]) -> Tensor:
        """Model rows that are visible in any view of the step."""
        parts = self._parts
        visible = torch.zeros(len(parts.table), dtype=torch.bool, device=parts.device)
        for item in rendered:
            seen = item.context.rendered.statistics.visible.any(0)
            rows = item.context.splats.rows
            if rows is not None:
                seen = torch.zeros_like(visible).index_copy(0, rows, seen)
            visible |= seen
        return parts.team.visible(visible)

    def _observe(
        self, forward: Forward, outcome: Outcome, views: tuple[int, ...], step: int
    ) -> None:
        """Pass all batches to refiners and sampler; zeros if the step was not finite."""
        parts, finite = self._parts, outcome.finite
        samples_by_loss = type(parts.sampler).observe is not Sampler.observe

        def absent(view: int) -> StepContext:
            return forward.absent(view, step, 1 / len(views))

        for seen in parts.team.observations(outcome.rendered, parts.refiners, absent):
            given = seen.statistics
            statistics = given if outcome.is_gated else given.where(finite)
            parts.refiners.observe(seen.context, statistics, parts.refined)
            if not samples_by_loss:
                continue
            batch = seen.context.batch.views
            with torch.no_grad():
                loss = torch.where(finite, seen.data_loss, 0.0)
                parts.sampler.observe(batch, loss.expand(len(batch)))

    def _time_of(self, view: int) -> float | None:
        """Capture time of a training view, in [0, 1]; known to the host."""
        return None if self._times is None else self._times[view]

    def state_dict(self) -> dict[str, Any]:
        """Numbers of skipped updates."""
        return {"skipped": self._skipped, "skipped_in_a_row": self._skipped_in_a_row}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``."""
        device = self._parts.device
        self._skipped = state["skipped"].to(device)
        self._skipped_in_a_row = state["skipped_in_a_row"].to(device)
