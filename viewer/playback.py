"""Playback: what moves by the clock: the time of a moving scene, and a flight along a path."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gsfw.viewer.key_frames import PathStates
from gsfw.viewer.view_state import ViewState

DURATION = 4.0
"""Seconds from the first time to the last at speed 1."""


@dataclass
class Playback:
    """Advances a time in [0, 1] by the clock."""

    playing: bool = False
    loop: bool = True
    speed: float = 1.0
    """Factor of the speed; at 1 a capture plays in ``DURATION`` seconds."""
    _last: float | None = None

    def play(self, playing: bool) -> None:
        """Start or stop; the time between a stop and the next start does not count."""
        self.playing, self._last = playing, None

    def advance(self, time: float, now: float) -> float:
        """The time at ``now`` (a clock in seconds), after ``time`` at the call before."""
        elapsed = 0.0 if self._last is None else now - self._last
        self._last = now
        moved = time + elapsed * self.speed / DURATION
        if moved <= 1.0:
            return moved
        if self.loop:
            return moved % 1.0
        self.play(False)
        return 1.0


@dataclass
class Flight:
    """A flight along a camera path, by the clock."""

    path: PathStates
    home: ViewState
    """The state before the flight: its pose, time and view are those after it."""
    ended: bool = False
    _began: float | None = None

    def state(self, state: ViewState, now: float) -> ViewState:
        """``state`` at its place at ``now`` (a clock in seconds); at home after the last frame."""
        self._began = now if self._began is None else self._began
        number = int((now - self._began) * self.path.fps)
        self.ended = number >= len(self.path)
        if not self.ended:
            return self.path.at(number, state)
        home = self.home
        return replace(state, pose=home.pose, time=home.time, view=home.view)
