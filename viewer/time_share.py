"""TimeShare: how long frames may be rendered now, so that training keeps its part of the time.

Frames cost more than the time in which they are rendered: threads that encode and send them, and a
browser on the same machine, slow down the steps beside them. So a step during which a frame is on
its way is charged with the time that it takes longer than usual.
"""

from __future__ import annotations

import statistics
from collections import deque

MOST_CREDIT = 0.25
"""Most seconds that are saved up: after a pause of the page, training does not stop for longer."""
MEASURED_SECONDS = 10.0
"""Time over which the share is measured."""
USUAL_STEPS, LEAST_STEPS = 31, 5
"""Undisturbed steps whose median is the usual time of one: at most, and at least."""


class TimeShare:
    """Counts the time of training and of frames, by the clock."""

    def __init__(self, share: float, now: float) -> None:
        """Allow frames this part of the time, from ``now`` on (a clock, in seconds)."""
        self._per_second = share / (1.0 - share)
        self._credit = 0.0
        self._since = now
        self._spans: deque[tuple[float, float, float]] = deque()
        self._undisturbed: deque[float] = deque(maxlen=USUAL_STEPS)

    def trained(self, now: float, disturbed: bool = False) -> None:
        """Training had the time since the last call.

        Args:
            now: by the clock, in seconds.
            disturbed: true if a frame was on its way meanwhile.
        """
        seconds, lost = now - self._since, 0.0
        if not disturbed:
            self._undisturbed.append(seconds)
        elif len(self._undisturbed) >= LEAST_STEPS:
            usual = statistics.median(self._undisturbed)
            # An evaluation or a refinement takes long for other reasons.
            lost = min(max(seconds - usual, 0.0), usual)
        trained = seconds - lost
        self._credit = min(self._credit + trained * self._per_second, MOST_CREDIT) - lost
        self._note(now, trained, lost)

    def rendered(self, now: float) -> None:
        """Frames had the time since the last call."""
        seconds = now - self._since
        self._credit -= seconds
        self._note(now, 0.0, seconds)

    def skip(self, now: float) -> None:
        """Nobody needed the time since the last call: the run was paused."""
        self._since = now

    @property
    def allowed(self) -> bool:
        """True if a frame may be rendered now; a long one is paid for afterwards."""
        return self._credit > 0

    @property
    def measured(self) -> float:
        """Part of the last seconds that frames took, in [0, 1]."""
        trained = sum(span[1] for span in tuple(self._spans))
        rendered = sum(span[2] for span in tuple(self._spans))
        return rendered / (trained + rendered) if rendered else 0.0

    def _note(self, now: float, trained: float, rendered: float) -> None:
        self._since = now
        if self._spans and now - self._spans[-1][0] < 0.1:  # One entry for a tenth of a second.
            began, before, already = self._spans[-1]
            self._spans[-1] = (began, before + trained, already + rendered)
        else:
            self._spans.append((now, trained, rendered))
        while self._spans and now - self._spans[0][0] > MEASURED_SECONDS:
            self._spans.popleft()
