"""Walk: a run's way through its schedule: updates, pace, and who may change it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any

from gsfw.core.datamanager import Views
from gsfw.core.loop.goal import Goal
from gsfw.core.loop.held_back import HeldBack
from gsfw.core.loop.pace import FASTEST, UNIT, Decision, Pace
from gsfw.core.loop.timekeeper import Standing, Timekeeper
from gsfw.core.refiner import GrowthLimits
from gsfw.core.sampler import Sampler

GIVEN_BACK = 0.9
"""Part of the schedule after which held-back views are trained on, whether or not the goal is
reached: the final model has seen all training views."""


class Walk:
    """Counts updates, and says which steps of the schedule each of them stands for."""

    def __init__(
        self,
        pace: Sequence[str],
        views: Views,
        held_back: int = 0,
        timekeeper: Timekeeper | None = None,
        goal: Goal | None = None,
    ) -> None:
        """Stand before the first update.

        Args:
            pace: recorded decisions.
            views: the training views.
            held_back: number of them that are held back, at most.
            timekeeper: keeps the run within a time; ``None``: nobody does.
            goal: ends the run when it is reached; ``None``: there is none.

        Raises:
            ConfigError: the recorded decisions are damaged.
        """
        self.updates = 0
        self.pace = Pace.parse(pace)
        self.held_back = HeldBack(views, held_back)
        self.timekeeper, self.goal = timekeeper, goal
        self._drawn = 0
        self._views: tuple[int, ...] = ()

    def begin(self, step: int) -> None:
        """Start the clock: training begins, or goes on after a step of the schedule."""
        if self.timekeeper is not None:
            self.timekeeper.restart(self.updates, step)

    def next_views(self, sampler: Sampler, step: int) -> tuple[int, ...]:
        """The views of an update at a step.

        A sampler that is a schedule is neither behind the schedule nor ahead of it; others give
        the views of one step for each update.
        """
        if not sampler.is_schedule or not self._views:
            self._draw(sampler)
        while sampler.is_schedule and self._drawn <= step:
            self._draw(sampler)
        return self._trained(self._views)

    def _draw(self, sampler: Sampler) -> None:
        self._views = sampler.next()
        self._drawn += 1

    def _trained(self, views: tuple[int, ...]) -> tuple[int, ...]:
        """The views, without those that are held back."""
        return views if self.pace.all_views(self.updates) else self.held_back.replace(views)

    def coming_views(self, sampler: Sampler, count: int) -> tuple[int, ...]:
        """Up to ``count`` views of the updates after the present one, to be loaded ahead."""
        span = self.pace.span(self.updates) if sampler.is_schedule else 1
        if count == 0 or self.pace.hastens(self.updates):
            return ()
        views, each = sampler.peek(count * max(span, 1)), max(len(self._views), 1)
        if span > 1:  # Of so many steps only the last one gets an update.
            views = tuple(v for i, v in enumerate(views) if i // each % span == span - 1)
        return self._trained(views)

    def advance(self, steps_left: int) -> tuple[int, GrowthLimits]:
        """Count an update: the steps that it stands for, and the limits that hold in them."""
        span = min(self.pace.span(self.updates), steps_left)
        limits = GrowthLimits(may_grow=not self.pace.hastens(self.updates))
        self.updates += 1
        return span, limits

    def decide(
        self,
        step: int,
        steps: int,
        gaussians: int,
        resolution: float,
        look: Callable[[Sequence[int]], float],
    ) -> None:
        """Change the pace after an update if the time or the goal asks for it.

        Args:
            step: finished steps of the schedule.
            steps: all of them.
            gaussians: rows of the model.
            resolution: width of the images of the update over their full width.
            look: measures the PSNR of some training views.
        """
        if step >= steps:
            return
        now = self.pace.thousandths(self.updates - 1)
        decision = self._by_goal(steps - step, look) or self._by_schedule(step / steps, now)
        if decision is None and self.timekeeper is not None:
            planned = self.pace.planned
            standing = Standing(self.updates, step, steps, gaussians, resolution, now, planned)
            decision = self._bounded(self.timekeeper.decide(standing), now)
        if decision is not None:
            self.pace.decide(decision)

    def _bounded(self, decision: Decision | None, now: int) -> Decision | None:
        """A decision by the clock; of a run with a goal, whose time need not be used up.

        Its pace is the planned one or higher, and its last part is as short as it is.
        """
        if decision is None or self.goal is None:
            return decision
        least = self.pace.planned if self.goal.reached is None else now
        thousandths = max(decision.thousandths, least)
        return None if thousandths == now else replace(decision, thousandths=thousandths)

    def _by_schedule(self, finished: float, now: int) -> Decision | None:
        """The decision that gives held-back views back near the end."""
        if not self.held_back.views or self.pace.all_views(self.updates) or finished < GIVEN_BACK:
            return None
        return Decision(self.updates, now, all_views=True)

    def _by_goal(self, steps_left: int, look: Callable[[Sequence[int]], float]) -> Decision | None:
        """The decision of the last part, if it begins now."""
        goal, views = self.goal, self.held_back.views
        if goal is None or not views or not goal.due(self.updates):
            return None
        if self.pace.all_views(self.updates):  # They are trained on, and judge nothing any more.
            return None
        with self.apart():
            found = look(views)
        if not goal.judge(self.updates, found):
            return None
        # Time that is left can only make the last part shorter.
        usual = self.pace.thousandths(self.updates)
        thousandths = max(math.ceil(steps_left * UNIT / goal.last_updates()), usual)
        return Decision(self.updates, min(thousandths, FASTEST), all_views=True)

    def unhurried(self) -> None:
        """Take one step of the schedule per update from now on: the run has another length.

        It has no goal any more, so that no view is held back for one.
        """
        if self.pace.thousandths(self.updates) != UNIT:
            # This update may have a decision already.
            self.pace.decide(Decision(self.updates + 1, UNIT, all_views=True))

    def apart(self) -> AbstractContextManager[None]:
        """Leave out the time inside, which is no part of an update."""
        return nullcontext() if self.timekeeper is None else self.timekeeper.apart()

    def evaluated(self, step: int, views: int) -> None:
        """Tell that the latest time apart was an evaluation of so many views."""
        if self.timekeeper is not None:
            self.timekeeper.evaluated(step, views)

    def state_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "updates": self.updates,
            "drawn": self._drawn,
            "views": list(self._views),
            "pace": [*self.pace.texts],
            "spent": 0.0 if self.timekeeper is None else self.timekeeper.spent(),
            "view_seconds": 0.0 if self.timekeeper is None else self.timekeeper.view_seconds,
            "goal": None if self.goal is None else self.goal.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any] | None, step: int) -> None:
        """Continue from ``state``; without one each finished step was one update."""
        state = state or {"updates": step, "drawn": step, "pace": []}
        self.updates, self._drawn = state["updates"], state["drawn"]
        self._views = tuple(state.get("views", ()))
        self.pace = Pace.parse(state["pace"])
        if self.goal is not None and state.get("goal"):
            self.goal.load_state_dict(state["goal"])
