"""TimeShare: how long frames may be rendered now, so that training keeps its part of the time."""

from __future__ import annotations

from collections import deque

MOST_CREDIT = 0.25
"""Most seconds that are saved up: after a pause of the page, training does not stop for longer."""
MEASURED_SECONDS = 10.0
"""Time over which the share is measured."""


class TimeShare:
    """Counts the time of training and of frames, by the clock."""

    def __init__(self, share: float, now: float) -> None:
        """Allow frames this part of the time, from ``now`` on (a clock, in seconds)."""
        self._per_second = share / (1.0 - share)
        self._credit = 0.0
        self._since = now
        self._spans: deque[tuple[float, float, float]] = deque()

    def trained(self, now: float) -> None:
        """Training had the time since the last call."""
        seconds = now - self._since
        self._credit = min(self._credit + seconds * self._per_second, MOST_CREDIT)
        self._note(now, seconds, 0.0)

    def rendered(self, now: float) -> None:
        """Frames had the time since the last call."""
        seconds = now - self._since
        self._credit -= seconds
        self._note(now, 0.0, seconds)

    def charge(self, seconds: float) -> None:
        """Other threads have sent frames meanwhile, on processors that training would use."""
        self._credit -= seconds
        self._note(self._since, -seconds, seconds)

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
