"""Timekeeper: keeps a run within its time by changing its pace.

A few times in every hundredth of the run it predicts how long the rest of the schedule takes at one
step per update (``remaining_time``), and compares that with the time that is left. A machine that
is busy for a while, or a model that grows more than expected, so leads to a higher pace, and an
idle machine to a lower one. What comes after the last step (evaluation, requirements, report) is
reserved: its work is known in renders of views and in fixed work, and how long these take now is
measured on the steps.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from gsfw.core.loop.machine_clock import MachineClock, Work
from gsfw.core.loop.pace import FASTEST, SLOWEST, UNIT, Decision
from gsfw.core.loop.remaining_time import RemainingTime

INTERVAL, SHORTEST = 0.01, 0.1
"""Time between two looks at the clock: this part of the limit, and at least so many seconds; or
this part of the schedule: a machine that gets fast walks far in little time."""
TOLERANCE = 0.02
"""The pace is left alone while the run would end right within this part of its time."""
SMOOTHING = 0.7
"""Weight of earlier looks in the time of an update, and in how busy the machine is."""
LARGEST_CHANGE = 1.5
"""Factor by which one decision changes the pace at most in the first half of the time: first steps
decode images and warm up, and a pause of some seconds is no reason to end soon."""
TRUST = 2.0
"""A pace exceeds the planned one by this times the part of the time that has passed, at most, in
the first half of it: costs of later steps are a guess, and rows grow, which haste spoils."""
SETTLING = 5
"""Looks of a process in which ``LARGEST_CHANGE`` holds at any time: it may have been resumed."""
FEWEST = 5
"""Steps between two looks at least."""
GRACE = 0.03
"""Part of the time that the last steps may take beyond it: what is reserved for the end is an
estimate, and a moment in which the machine is busy is no reason to drop what is left."""
LAST_UPDATES = 3
"""Updates in which a run ends whose time is over."""


@dataclass(frozen=True)
class Standing:
    """Progress of a run."""

    updates: int
    step: int
    """Finished steps of the schedule."""
    steps: int
    """All steps of the schedule."""
    gaussians: int
    resolution: float
    """Width of the images of the latest update over their full width."""
    thousandths: int
    """The pace of the latest update."""
    planned: int = UNIT
    """The pace that the run was planned with, in thousandths."""


@dataclass(frozen=True)
class Ending:
    """The work between the last step of a run and the end of its process."""

    updates: float = 0.0
    """Work that takes as long as so many updates at full image size: renders of views."""
    seconds: float = 0.0
    """Seconds of other work, on a machine that is idle besides."""


class Timekeeper:
    """Decides on the pace of one run."""

    def __init__(
        self,
        remaining: RemainingTime,
        limit: float,
        ending: Ending,
        clock: MachineClock,
        spent: float = 0.0,
    ) -> None:
        """Start with nothing measured.

        Args:
            remaining: of this run; told nothing yet.
            limit: seconds from the start of the run to its end.
            ending: the work after the last step.
            clock: counts from the start of this process.
            spent: seconds that the run took before this process: it was resumed.
        """
        self._remaining, self._limit, self._ending = remaining, limit, ending
        self._clock, self._spent = clock, spent
        self._last: float | None = None
        self._work = Work()
        self._since = self._last_step = self._looks = 0
        self._apart = self._latest_apart = 0.0
        self._update_seconds = 0.0
        self._busy = 0.0
        self._began = 0.0
        """Seconds of the run before it trained; 0 for one that was resumed."""

    @property
    def limit(self) -> float:
        """Seconds from the start of the run to its end."""
        return self._limit

    def spent(self) -> float:
        """Seconds of the run so far, with those of earlier processes."""
        return self._spent + self._clock.seconds()

    @property
    def view_seconds(self) -> float:
        """Seconds of a view in the latest evaluation, or as they were expected."""
        return self._remaining.view_seconds

    def restart(self, updates: int, step: int) -> None:
        """Measure from now on: training begins, or goes on.

        Args:
            updates: number of finished updates.
            step: finished steps of the schedule.
        """
        self._last, self._work = self._clock.seconds(), self._clock.work()
        self._since, self._last_step = updates, step
        self._began = self.spent() if step == 0 else 0.0

    @contextmanager
    def apart(self) -> Iterator[None]:
        """Leave out the time inside, which is no part of a step."""
        before = self._clock.seconds()
        try:
            yield
        finally:
            self._latest_apart = self._clock.seconds() - before
            self._apart += self._latest_apart

    def evaluated(self, step: int, views: int) -> None:
        """Learn that the latest time apart was an evaluation of so many views."""
        self._remaining.evaluated(step, self._latest_apart, views)

    def decide(self, standing: Standing) -> Decision | None:
        """Look at the clock; the decision after this update, if the pace has to change."""
        now = self._clock.seconds()
        if self._last is None:
            self.restart(standing.updates, standing.step)
            return None
        seconds = now - self._last - self._apart
        is_far = standing.step - self._last_step >= max(INTERVAL * standing.steps, FEWEST)
        is_long = seconds >= max(INTERVAL * self._limit, SHORTEST)
        if not (is_far or is_long) or standing.step >= standing.steps:
            return None
        self._learn(standing, now, seconds)
        wanted = self._wanted(standing, now)
        return None if wanted is None else Decision(standing.updates, wanted)

    def _learn(self, standing: Standing, now: float, seconds: float) -> None:
        """Learn from the updates since the last look."""
        update_seconds = seconds / max(standing.updates - self._since, 1)
        self._update_seconds = _smoothed(self._update_seconds, update_seconds)
        work = self._clock.work()
        self._busy = _smoothed(self._busy, work.slowdown(self._work))
        self._remaining.observe(
            standing.step, standing.gaussians, standing.resolution, update_seconds
        )
        self._last, self._since, self._last_step = now, standing.updates, standing.step
        self._work, self._apart, self._looks = work, 0.0, self._looks + 1

    def _wanted(self, standing: Standing, now: float) -> int | None:
        """The pace, in thousandths, that ends the run in time; ``None`` to leave it alone."""
        steps_left = standing.steps - standing.step
        needed = self._remaining.steps_seconds()
        left = self._limit - self._spent - now - self.reserved(standing)
        grace = GRACE * self._limit
        if left < -grace:
            rush = _within(math.ceil(steps_left * UNIT / LAST_UPDATES))
            return rush if rush > standing.thousandths else None
        if needed is None:
            return None
        needed *= UNIT / standing.thousandths
        if abs(needed - left) < TOLERANCE * self._limit or (left < grace and needed < grace):
            return None
        change = needed / max(left, grace)
        if now + self._spent < self._limit / 2 or self._looks <= SETTLING:
            change = min(max(change, 1 / LARGEST_CHANGE), LARGEST_CHANGE)
        most = self._most(standing.planned, now + self._spent)
        return _within(min(math.ceil(change * standing.thousandths), most))

    def _most(self, planned: int, passed: float) -> int:
        """The highest pace after some seconds of a run, in thousandths."""
        part = (passed - self._began) / max(self._limit - self._began, 1e-9)
        return math.ceil((1 + TRUST * part) * planned) if part < 0.5 else FASTEST

    def reserved(self, standing: Standing) -> float:
        """Seconds that are kept for what comes after the last step."""
        full = self._update_seconds / max(standing.resolution, 1e-3)
        renders = self._ending.updates * full
        return (
            renders
            + self._ending.seconds * max(self._busy, 1.0)
            + self._remaining.evaluation_seconds()
        )


def _within(thousandths: int) -> int:
    return min(max(thousandths, SLOWEST), FASTEST)


def _smoothed(before: float, now: float) -> float:
    return SMOOTHING * before + (1 - SMOOTHING) * now if before else now
