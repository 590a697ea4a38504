"""Remaining time of a run, by a model of its growth instead of the rate of the moment.

The time of a step is modelled as the cost of its phase times powers of the numbers of Gaussians and
of pixels, times a factor that is measured over the recent steps. Phases are the method's own (a
field or further times are trained from some step on). The number of Gaussians grows until
refinements end, as it grew so far and, as long as few refinements were seen, as usual runs do.
Waiting for images is apart: each view is decoded once, if all fit into the cache. Evaluations take
as long for a view as the last one.

Measured over 258 recorded runs (``benchmarks/remaining_time.py``).
"""

from __future__ import annotations

from dataclasses import dataclass

from gsfw.core.callback import RunInfo
from gsfw.core.loop.growth_limit import most_gaussians

GROWTH_EXPONENT, PIXELS_EXPONENT = 0.5, 0.35
"""Exponents of the time of a step in the number of Gaussians and of pixels. Measured: 0.5 to 0.7
between 10,000 and 150,000 Gaussians at 100 to 200 pixels; of pixels 0.2 on chair (200 x 200, 15,000
Gaussians) and 0.3 to 0.45 on fox (180 x 320, 29,000 and 57,000), as much of a short step is fixed.
"""
RECENT = 0.3
"""The factor is measured over this last part of the finished steps."""
USUAL_FACTOR = 4.0
"""Factor by which rows usually grow, over all refinements of a run. A refinement of a long run so
adds 1 %, the median of 196 recorded runs with ADC, and one of 8 in a run of 1000 steps 19 %."""
WEIGHT_OF_USUAL, SHARE_OF_USUAL = 8, 0.25
"""Number of refinements that this weighs as much as, at most, and that as part of all of them."""
LEAST_STEPS, LEAST_SECONDS = 20, 2.0
"""Nothing is said before so many steps and seconds: the first steps decode images and warm up."""
ENOUGH_STEPS = 10
"""Steps of a phase, or after the first pass, that say more than all that came before."""
PARTS = 40
"""Parts of the remaining steps in the sum over them."""


@dataclass(frozen=True)
class _Interval:
    """The steps between two reports."""

    end: int
    """Finished steps at its end."""
    steps: int
    gaussians: int
    resolution: float
    seconds: float
    """Time of all its steps, without waiting for images."""
    waiting: float
    """Time in which steps waited for images."""


class RemainingTime:
    """Learns from reports of steps and evaluations, and predicts the rest of the run."""

    def __init__(self, run: RunInfo, recent: float = RECENT) -> None:
        """Know nothing but the run: its length, its settings and its phases.

        Args:
            run: the run.
            recent: the last part of the finished steps over which the speed is measured.
        """
        self._recent_part = recent
        self._run, self._steps, self._first = run, run.steps, run.first_step
        self._settings, self._phases, self._views = run.settings, run.step_costs, run.views
        self._refine_every = int(run.settings.get("strategy.refine_every", 0) or 0)
        self._seen: list[_Interval] = []
        self._view_seconds, self._evaluated_at = 0.0, 0

    def observe(
        self, step: int, gaussians: int, resolution: float, seconds: float, waiting: float = 0.0
    ) -> None:
        """Learn from a report.

        Args:
            step: number of finished steps.
            gaussians: rows of the model.
            resolution: width of the images over their full width.
            seconds: mean time of a step since the last report.
            waiting: the part of it in which it waited for images.
        """
        before = max(self._seen[-1].end if self._seen else self._first, self._evaluated_at)
        count = step - before
        if count > 0:
            own = max(seconds - waiting, 0.0) * count
            self._seen.append(_Interval(step, count, gaussians, resolution, own, waiting * count))

    def evaluated(self, step: int, seconds: float, views: int) -> None:
        """Learn the duration of an evaluation after ``step``; reported times begin anew there."""
        self._view_seconds, self._evaluated_at = seconds / max(views, 1), step

    @property
    def view_seconds(self) -> float:
        """Time of a view in the latest evaluation; 0 as long as it is not known."""
        return self._view_seconds

    def seconds(self, stretch: int | float = 1.0) -> float | None:
        """Time until the end of the last evaluation; ``None`` as long as it cannot be known.

        Args:
            stretch: time from step to step, over that of a step: more than 1 if others take a part.
        """
        steps = self.steps_seconds()
        return None if steps is None else stretch * steps + self.evaluation_seconds()

    def steps_seconds(self) -> float | None:
        """Time of the remaining steps; ``None`` as long as it cannot be known."""
        if not self._seen:
            return None
        now = self._seen[-1].end
        recent = self._recent(now)
        spent = sum(item.seconds + item.waiting for item in self._seen)
        if now - self._first < LEAST_STEPS or spent < LEAST_SECONDS or not recent:
            return None
        units = sum(
            item.steps * self._unit(item.end - item.steps, item.gaussians, item.resolution)
            for item in recent
        )
        factor = sum(item.seconds for item in recent) / units
        slope = self._growth(now, self._refinement()[0])
        left = self._units_left(now, self._seen[-1].gaussians, slope)
        return factor * left + self._waiting_left(now)

    def mean_cost(self, gaussians: int) -> float:
        """Mean time of all steps over that of one at the start, at full image size.

        Args:
            gaussians: rows of the model at the start.
        """
        slope = self._usual_growth() * gaussians
        left = self._units_left(self._first, gaussians, slope)
        return left / (self._steps - self._first) / self._unit(self._first, gaussians, 1.0)

    def _recent(self, now: int) -> list[_Interval]:
        """The last intervals; of the present phase alone, and after the first pass, if they do."""
        start = now - max(self._recent_part * (now - self._first), LEAST_STEPS)
        recent = [item for item in self._seen if item.end > start]
        began = max(first for first, _ in self._phases if first <= now)
        # Up to the end of the first pass steps share the processor with decoding.
        for least in (self._first + self._views, began, self._first + 1):
            after = [item for item in recent if item.end - item.steps >= least]
            if sum(item.steps for item in after) >= ENOUGH_STEPS:
                recent = after
        return recent

    def _unit(self, step: int, gaussians: int, resolution: float) -> float:
        """Relative time of a step."""
        cost = next((cost for first, cost in reversed(self._phases) if step >= first), 1.0)
        size = max(gaussians, 1) ** GROWTH_EXPONENT
        return cost * size * (resolution * resolution) ** PIXELS_EXPONENT

    def _units_left(self, now: int, gaussians: int, slope: float) -> float:
        """Sum of the relative times of the remaining steps.

        Args:
            now: finished steps.
            gaussians: rows of the model.
            slope: rows that refinements add, per step.
        """
        left = self._steps - now
        start, stop = self._refinement()
        most = max(most_gaussians(self._settings, self._run.view_pixels, gaussians), gaussians)
        total = 0.0
        for part in range(PARTS):
            step = now + left * (part + 0.5) / PARTS
            grown = slope * max(0.0, min(step, stop) - max(now, start))
            count = min(max(int(gaussians + grown), 1), most)
            total += self._unit(int(step), count, self._resolution(step)) * left / PARTS
        return total

    def _resolution(self, step: float) -> float:
        """Width of the images of a later step over their full width."""
        stages = self._run.image_stages
        return next((1 / divisor for first, divisor in reversed(stages) if step >= first), 1.0)

    def _refinement(self) -> tuple[int, int]:
        """First and last step of refinements; equal where there are none."""
        settings = self._settings
        if not self._refine_every:
            return 0, 0
        start = int(settings.get("strategy.refine_start", 0))
        return start, min(int(settings.get("strategy.refine_stop", self._steps)), self._steps)

    def _growth(self, now: int, start: int) -> float:
        """Rows that refinements add, per step."""
        every = self._refine_every
        if not every:
            return 0.0
        last = self._seen[-1].gaussians
        middle = max(start, (max(start, self._first) + now) // 2)
        before = [item for item in self._seen if item.end <= middle] or self._seen[:1]
        steps = now - before[-1].end
        rounds = max(0.0, (now - max(start, self._first)) / every)
        observed = (last - before[-1].gaussians) * every / steps if steps > 0 and rounds else 0.0
        weight = min(WEIGHT_OF_USUAL, SHARE_OF_USUAL * self._rounds())
        usual = self._usual_growth() * every * last
        a_round = (observed * rounds + usual * weight) / (rounds + weight)
        return a_round / every

    def _rounds(self) -> float:
        """Number of refinements of the run, at least one."""
        every = self._refine_every
        start, stop = self._refinement()
        return max((stop - start) / every, 1.0) if every else 1.0

    def _usual_growth(self) -> float:
        """Part by which rows usually grow in a step, while they are refined."""
        every = self._refine_every
        return (USUAL_FACTOR ** (1 / self._rounds()) - 1) / every if every else 0.0

    def _waiting_left(self, now: int) -> float:
        """Time that steps will wait for images: in the first pass, and after it as they do now."""
        last = self._seen[-1]
        done = now - self._first
        if self._views and done < self._views:
            return last.waiting / last.steps * min(self._views - done, self._steps - now)
        after = [item for item in self._seen if item.end - item.steps - self._first >= self._views]
        steps = sum(item.steps for item in after)
        return sum(item.waiting for item in after) / steps * (self._steps - now) if steps else 0.0

    def evaluation_seconds(self) -> float:
        """Time of the remaining evaluations: of samples, and of all views at the end."""
        now = self._seen[-1].end if self._seen else self._first
        every = int(self._settings.get("eval_every", 0) or 0)
        held_out = int(self._run.protocol.get("views", 0))
        sample = int(self._settings.get("eval_views", 0) or 0) or held_out
        before_last = (self._steps - 1) // every - now // every if every else 0
        return self._view_seconds * (before_last * min(sample, held_out) + held_out)
