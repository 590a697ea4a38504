"""Trainer: the one loop, for static and dynamic methods alike."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import torch

from gsfw.core.callback import Callback, Control, RunInfo, StepReport, TrainingView
from gsfw.core.datamanager import Split
from gsfw.core.errors import TrainingError
from gsfw.core.loop.determinism import deterministic, environment
from gsfw.core.loop.device import moved, wait_for
from gsfw.core.loop.evaluation import Evaluation, evaluate
from gsfw.core.loop.forward import RenderedBatch, culprits, shared_losses, without_data
from gsfw.core.loop.full_memory import memory_full
from gsfw.core.loop.goal import Goal, mean_psnr
from gsfw.core.loop.memory import memory_summary, peak_memory_mb, release_freed_memory
from gsfw.core.loop.memory_watch import MemoryWatch
from gsfw.core.loop.model_handle import ModelHandle
from gsfw.core.loop.recording import recorder_for
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.schedule import checkpoint_due, evaluation_due
from gsfw.core.loop.stopwatch import Stopwatch
from gsfw.core.loop.timekeeper import Timekeeper
from gsfw.core.loop.training_parts import TrainingParts, TrainingPlan
from gsfw.core.loop.update import Update
from gsfw.core.loop.verdict import Verdict
from gsfw.core.loop.walk import Walk
from gsfw.core.loop.watchers import Watchers
from gsfw.core.metrics import psnr
from gsfw.core.part_state import load_part, state_of
from gsfw.core.progress import stage
from gsfw.core.refiner import RESET, GrowthLimits, Refinement


class Trainer:
    """Batches -> splats -> render -> decode -> losses -> backward -> observe -> step -> refine."""

    def __init__(
        self,
        parts: TrainingParts,
        plan: TrainingPlan,
        folder: RunFolder,
        info: RunInfo,
        callbacks: Sequence[Callback] = (),
        timekeeper: Timekeeper | None = None,
        goal: Goal | None = None,
    ) -> None:
        self.parts, self.plan, self.folder, self.info = parts, plan, folder, info
        self.control = Control()
        self.step = 0
        self.train_seconds = 0.0
        self.callbacks = Watchers(callbacks)
        self._stopwatch = Stopwatch()
        recorder = recorder_for(parts.device) if plan.records_steps else None
        self.updates = Update(parts, self._stopwatch, recorder)
        self._memory = MemoryWatch(plan.checks_memory, parts.device)
        self._checkpointed = -1
        self._refined: Counter[str] = Counter()
        views = parts.data.views(Split.TRAIN)
        self.walk = Walk(plan.pace, views, plan.held_back, timekeeper, goal)
        self._names = views.names
        self._widths = [camera.width for camera in views.cameras]
        self._handle: ModelHandle | None = None
        if not parts.team.shares_rendering:
            self._handle = ModelHandle(parts.shown, parts.rasterizer, plan.settings)
        self._verdict = Verdict(parts, plan, info.settings)

    def fit(self, afterwards: Callable[[], None] | None = None) -> dict[str, Any]:
        """Train until the plan's end or until a callback requests a stop; return the summary.

        Args:
            afterwards: called when a run is completed and has written its figures, before the
                callbacks are closed.

        Raises:
            TrainingError: too many steps in a row were not finite, or the GPU's memory is full.
            OutputError: a checkpoint could not be written.
        """
        with deterministic(self.parts.device), self.updates.working():
            try:
                if self._checkpointed != self.walk.updates:
                    self._checkpoint()  # Also checks that the folder is writable.
                self.callbacks.on_start(self._started(), self.control)
                release_freed_memory()  # That of the start.
                self._stopwatch.restart()
                self.walk.begin(self.step)
                while self.step < self.plan.steps and not self._stops():
                    self._one_step()
                summary = self._finish()
                if summary["completed"] and afterwards is not None:
                    afterwards()
                return summary
            except torch.OutOfMemoryError as error:
                raise memory_full(error, self) from None
            finally:
                self.callbacks.close()

    def _started(self) -> RunInfo:
        """The facts about the run, with the model that is trained and its data."""
        return replace(self.info, model=self._handle, data=self.parts.data)

    def _stops(self) -> bool:
        """True if a callback or a signal, in any process, has requested a stop."""
        parts, control = self.parts, self.control
        wanted = control.stop_reason is not None
        stops = parts.team.stops(wanted, parts.table, parts.generator)
        if stops and not wanted:
            control.request_stop("interrupted in another process")
        return stops

    def _one_step(self) -> None:
        """Run one update and the steps of the schedule that it stands for (``core.loop.pace``)."""
        room = self._memory.limits(self)
        rendered, first = self._update(), self.step
        span, limits = self.walk.advance(self.plan.steps - self.step)
        limits &= room
        is_reset = False
        for _ in range(span):
            started = time.perf_counter()
            is_reset |= RESET in self._refine(limits)
            self._stopwatch.step_done()
            self.step += 1
            self.train_seconds += time.perf_counter() - started
        self.updates.is_underway = False
        # In haste many steps pass in little time: evaluations due in them wait for the end.
        is_calm = limits.may_grow and not (is_reset and span > 1)
        self._follow_up(rendered, range(first + 1, self.step + 1), is_calm)
        resolution = self._resolution(rendered[0]) if rendered else 1.0
        look = partial(mean_psnr, self.parts, self.plan)
        self.walk.decide(self.step, self.plan.steps, len(self.parts.table), resolution, look)

    def _update(self) -> list[RenderedBatch]:
        """Render the views of a step, and update all parameters."""
        started = time.perf_counter()
        sampler = self.parts.sampler
        views = self.walk.next_views(sampler, self.step)
        coming = self.walk.coming_views(sampler, self.plan.prefetch_views)
        rendered = self.updates.run(self.plan, views, coming, self.step)
        self.train_seconds += time.perf_counter() - started
        return rendered

    def _refine(self, limits: GrowthLimits) -> Refinement:
        """Let the refiners edit rows after a step of the schedule; returns their edits."""
        parts = self.parts
        with self._stopwatch.stage("refine"):
            edits = parts.refiners.refine(
                self.step,
                self.plan.steps,
                parts.table,
                parts.refined,
                parts.generator,
                limits,
                parts.operators,
            )
            self._refined.update(edits)
        return edits

    # After a step. Here, and in refinements, the host reads GPU results, and waits for them.

    def _catch_up(self) -> None:
        """Wait for the steps that a GPU has not finished: their time is training time."""
        started = time.perf_counter()
        wait_for(self.parts.device)
        self.train_seconds += time.perf_counter() - started

    def _follow_up(self, rendered: list[RenderedBatch], passed: range, is_calm: bool) -> None:
        """Report, evaluate and write a checkpoint, if that is due.

        Args:
            rendered: batches of the latest update.
            passed: numbers of finished steps that the update has reached.
            is_calm: true if evaluations on the way are wanted.
        """
        plan, step = self.plan, self.step
        if passed:
            with self._stopwatch.paused():
                self.callbacks.on_tick(step, self.control)
        if any(done % plan.log_every == 0 or done in (1, plan.steps) for done in passed):
            self._report(rendered)
        if any(done % min(plan.log_every, plan.max_skipped) == 0 for done in passed):
            self._check_skipped(rendered)
        is_evaluated = any(
            evaluation_due(done, plan.steps, plan.eval_every, self._resets_after) for done in passed
        )
        if is_evaluated and is_calm and self._takes_part:
            self._evaluate()
            self._stopwatch.restart()
        due = any(checkpoint_due(done, plan.steps, plan.checkpoint_every) for done in passed)
        if due or self.control.checkpoint_requested:
            self._checkpoint()

    def _resets_after(self, done: int) -> bool:
        """True if opacities are reset after ``done`` steps."""
        return self.parts.refiners.reset_due(done - 1)

    @torch.no_grad()
    def _report(self, rendered: list[RenderedBatch]) -> None:
        self._catch_up()
        team = self.parts.team
        # Processes that share rendering have the same images, and their own rows.
        named = rendered if team.leads or not team.shares_rendering else without_data(rendered)
        own = (shared_losses(named), peak_memory_mb(self.parts.device))
        losses, memory = map(_summed, zip(*team.gathered(own), strict=True))
        if not team.leads:
            return
        context = rendered[0].context
        valid = None if context.batch.valid is None else context.batch.valid[0]
        name = self._names[context.batch.views[0]]
        step_ms, stage_ms = self._stopwatch.read()
        report = StepReport(
            step=self.step,
            loss=sum(losses.values()),
            losses=losses,
            psnr=psnr(context.rendered.color[0], context.target[0], valid),
            num_gaussians=len(self.parts.table),
            learning_rates=self.parts.optimizer.learning_rates(self.step - 1),
            step_ms=step_ms,
            stage_ms=stage_ms,
            memory_mb=memory,
            skipped_steps=self.updates.skipped,
            resolution=self._resolution(rendered[0]),
            refined=dict(self._refined),
            view=TrainingView(name, context.target[0], context.rendered.color[0].detach()),
            model=self._handle,
        )
        self._refined.clear()
        self.callbacks.on_step(report, self.control)

    def _resolution(self, item: RenderedBatch) -> float:
        """Width of the images of a batch over their full width."""
        batch = item.context.batch
        return batch.cameras.width / self._widths[batch.views[0]]

    def _check_skipped(self, rendered: list[RenderedBatch]) -> None:
        """Stop after too many steps in a row that were not finite; reads the flag rarely.

        Only the first of several processes does, and ends the others, unless all have to
        write the state together.
        """
        if not self._takes_part:
            return
        self._catch_up()
        skipped_in_a_row = self.updates.skipped_in_a_row
        if skipped_in_a_row >= self.plan.max_skipped:
            self._checkpoint()  # Skipped steps change no parameter: the state is finite.
            if not self.parts.team.leads:
                return
            raise TrainingError(
                f"{skipped_in_a_row} steps in a row had a loss or gradient that is not finite; "
                f"stopped at step {self.step}.{culprits(rendered)}",
                f"The last good state is in {self.folder.checkpoints}. Try lower learning rates "
                "(optim.means_lr=...), or look for broken images or poses with gsfw info DATA.",
            )

    def _evaluate(self) -> Evaluation:
        """Evaluate; other processes wait for the first one in their next step."""
        self._catch_up()
        with self.walk.apart():
            evaluation = self._judged()
            self.callbacks.on_evaluation(self.step, evaluation, self.control)
        self.walk.evaluated(self.step, len(evaluation.views))
        return evaluation

    def _judged(self) -> Evaluation:
        """The evaluation of the model as it is, with its findings."""
        parts = self.parts
        evaluation = evaluate(
            parts,
            self.plan.settings,
            on_view=partial(self.callbacks.on_view, self.step),
            method=parts.method,
            baselines=self._verdict.baselines,
            most=0 if self.step >= self.plan.steps else self.plan.eval_views,
        )
        evaluation = self._verdict.judge(self.step, evaluation)
        self._verdict.log(self.step, evaluation.findings or ())
        return evaluation

    def _finish(self) -> dict[str, Any]:
        completed = self.step >= self.plan.steps
        if not self._takes_part:
            return {"completed": completed}
        if self._checkpointed != self.walk.updates:
            self._checkpoint()
        self.updates.give_up()
        summary: dict[str, Any] = {"completed": completed}
        if completed:
            evaluation = self._evaluate()
            summary |= evaluation.means
            summary |= {"views": len(evaluation.views), "render_ms": evaluation.render_ms}
            summary |= evaluation.time_document() | evaluation.verdict_document()
        else:
            summary["stopped"] = self.control.stop_reason
        team = self.parts.team
        self.parts = team.reunited(self.parts, self.folder.path)
        summary |= {
            "num_gaussians": len(self.parts.table),
            "train_seconds": round(self.train_seconds, 3),
            "steps": self.step,
            **({} if self.walk.updates == self.step else {"updates": self.walk.updates}),
            "skipped_steps": self.updates.skipped,
            **self._sizes(),
            **team.summary(),
            **self.parts.corrections.summary(),
            "optimizer_bytes": self.parts.optimizer.num_bytes(),
            **memory_summary(self.parts.device),
        }
        self.callbacks.on_end(self.step, summary)
        return summary

    def _sizes(self) -> dict[str, int | float]:
        """Figures of the model; of a moving scene also the mean bytes of a captured time."""
        sizes, times = dict(self.parts.model.summary()), self.parts.data.scene.num_times
        if times > 1:
            sizes["bytes_per_time"] = round(sizes["model_bytes"] / times)
        return sizes

    # State.

    @property
    def _takes_part(self) -> bool:
        """True if this process evaluates and gathers checkpoints: the first one, or all."""
        return self.parts.team.leads or self.parts.team.shares_rendering

    def _checkpoint(self) -> None:
        self._catch_up()
        if not self._takes_part:
            return
        self._checkpointed = self.walk.updates
        state = self.parts.team.whole(self.state_dict(), self.parts, self.folder.path)
        if state is None:
            return
        with stage("writing a checkpoint"), self.walk.apart():
            path = self.folder.write_checkpoint(self.step, state)
            release_freed_memory()  # That of writing, which steps do not need.
        self.control.checkpoint_requested = False
        with self._stopwatch.paused():
            self.callbacks.on_checkpoint(self.step, path)

    def keep_state(self, together: bool = False) -> None:
        """Write a checkpoint in place of further steps, if none has changed a part of the state.

        Views that an unfinished step has drawn count as seen.

        Args:
            together: true if all processes of the team do so between the same two steps.
        """
        is_whole = (together or self.parts.team.size == 1) and not self.updates.is_underway
        if is_whole and self._checkpointed != self.walk.updates:
            self._checkpoint()

    def state_dict(self) -> dict[str, Any]:
        """All state of the training: tensors and plain data."""
        parts = self.parts
        return {
            "model": state_of(parts.model),
            "corrections": dict(parts.corrections.state_dict()),
            "optimizer": state_of(parts.optimizer),
            "refiners": parts.refiners.state_dict(),
            "sampler": state_of(parts.sampler),
            "method": state_of(parts.method),
            "generator": parts.generator.get_state(),
            "walk": self.walk.state_dict(),
            "train_seconds": self.train_seconds,
            **self.updates.state_dict(),
            "environment": environment(parts.device, parts.rasterizer.capabilities().details),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a checkpoint of any device."""
        parts = self.parts
        state = parts.team.own_state(state, parts)
        load_part(parts.model, state["model"])
        parts.corrections.load_state(state)
        load_part(parts.optimizer, state["optimizer"])
        parts.refiners.load_state_dict(moved(state["refiners"], parts.device))
        load_part(parts.sampler, moved(state["sampler"], parts.device))
        load_part(parts.method, moved(state["method"], parts.device))
        if state["environment"]["device"] == parts.device.type:
            parts.generator.set_state(state["generator"].cpu())
        else:  # Generators of different devices have states of different kinds.
            parts.generator.manual_seed(parts.generator.initial_seed() + state["step"])
        self.train_seconds = state["train_seconds"]
        self.updates.load_state_dict(state)
        self.step = state["step"]
        self.walk.load_state_dict(state.get("walk"), self.step)
        self._checkpointed = self.walk.updates


def _summed(parts: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Sums by name."""
    return {name: sum(part.get(name, 0.0) for part in parts) for part in parts for name in part}
