"""Trainer: the one loop, for static and dynamic methods alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import torch

from gsfw.core.callback import Callback, Control, RunInfo
from gsfw.core.datamanager import Split
from gsfw.core.errors import TrainingError
from gsfw.core.loop.checkpoints import Checkpoints
from gsfw.core.loop.determinism import deterministic, environment
from gsfw.core.loop.device import moved, wait_for
from gsfw.core.loop.evaluation import Evaluation, evaluate
from gsfw.core.loop.final_figures import final_figures
from gsfw.core.loop.forward import RenderedBatch, culprits
from gsfw.core.loop.full_memory import memory_full
from gsfw.core.loop.goal import Goal, mean_psnr
from gsfw.core.loop.memory import release_freed_memory
from gsfw.core.loop.memory_watch import MemoryWatch
from gsfw.core.loop.model_handle import ModelHandle
from gsfw.core.loop.recording import recorder_for
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.schedule import checkpoint_due, evaluation_due
from gsfw.core.loop.step_reports import StepReports
from gsfw.core.loop.stopwatch import Stopwatch
from gsfw.core.loop.timekeeper import Timekeeper
from gsfw.core.loop.training_parts import TrainingParts, TrainingPlan
from gsfw.core.loop.update import Update
from gsfw.core.loop.verdict import Verdict
from gsfw.core.loop.walk import Walk
from gsfw.core.loop.watchers import Watchers
from gsfw.core.part_state import load_part, state_of
from gsfw.core.refiner import RESET, GrowthLimits, Refinement


class Trainer:
    """Batches -> splats -> render -> decode -> losses -> backward -> step -> observe -> refine."""

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
        self.checkpoints = Checkpoints(self._stopwatch)
        views = parts.data.views(Split.TRAIN)
        self.walk = Walk(plan.pace, views, plan.held_back, timekeeper, goal)
        self._handle: ModelHandle | None = None
        if not parts.team.shares_rendering:
            self._handle = ModelHandle(parts.shown, parts.rasterizer, plan.settings)
        self._reports = StepReports(views, self._stopwatch, self._handle)
        self._verdict = Verdict(parts, plan, info.settings)

    def fit(self, afterwards: Callable[[], None] | None = None) -> dict[str, Any]:
        """Train until the plan's end or until a callback requests a stop; return the summary.

        Args:
            afterwards: called when a run is completed and has written its figures, before the
                callbacks are closed.

        Raises:
            TrainingError: too many steps in a row were not finite, the GPU's memory is full, or no
                checkpoint can hold the state of a part.
            OutputError: a checkpoint could not be written.
        """
        with deterministic(self.parts.device), self.updates.working():
            try:
                if not self.checkpoints.are_current(self):
                    self.checkpoints.write(self)  # Also checks that the folder is writable.
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
            except Exception as error:
                self.checkpoints.keep_after(error, self)
                raise
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
        resolution = self._reports.resolution(rendered[0]) if rendered else 1.0
        look = partial(mean_psnr, self.parts, self.plan, self.step)
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
            self._reports.count(edits)
        return edits

    # After a step. Here, and in refinements, the host reads GPU results, and waits for them.

    def catch_up(self) -> None:
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
        if is_evaluated and is_calm and self.parts.team.evaluates:
            self._evaluate()
            self._stopwatch.restart()
        due = any(checkpoint_due(done, plan.steps, plan.checkpoint_every) for done in passed)
        if due or self.control.checkpoint_requested:
            self.checkpoints.write(self)

    def _resets_after(self, done: int) -> bool:
        """True if opacities are reset after ``done`` steps."""
        return self.parts.refiners.reset_due(done - 1)

    @torch.no_grad()
    def _report(self, rendered: list[RenderedBatch]) -> None:
        self.catch_up()
        report = self._reports.make(self.step, rendered, self.parts, self.updates)
        if report is not None:
            self.callbacks.on_step(report, self.control)
        self.checkpoints.check(self)

    def _check_skipped(self, rendered: list[RenderedBatch]) -> None:
        """Stop after too many steps in a row that were not finite; reads the flag rarely.

        Only the first of several processes does, and ends the others, unless all have to
        write the state together.
        """
        if not self.parts.team.evaluates:
            return
        self.catch_up()
        skipped_in_a_row = self.updates.skipped_in_a_row
        if skipped_in_a_row >= self.plan.max_skipped:
            self.checkpoints.write(self)  # Skipped steps change no parameter: the state is finite.
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
        self.catch_up()
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
            step=self.step,
        )
        evaluation = self._verdict.judge(self.step, evaluation)
        self._verdict.log(self.step, evaluation.findings or ())
        return evaluation

    def _finish(self) -> dict[str, Any]:
        completed = self.step >= self.plan.steps
        if not self.parts.team.evaluates:
            return {"completed": completed}
        if not self.checkpoints.are_current(self):
            self.checkpoints.write(self)
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
        summary |= final_figures(self, team)
        self.callbacks.on_end(self.step, summary)
        return summary

    # State.

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
        self.checkpoints.loaded(self)
