"""Viewport: the newest state of one page, and how far it is rendered; stale wishes are dropped."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

from gsfw.viewer.budget import FrameBudget
from gsfw.viewer.frame import Frame
from gsfw.viewer.key_frames import PathStates
from gsfw.viewer.playback import Flight, Playback
from gsfw.viewer.view_state import ViewState

logger = logging.getLogger(__name__)

REST_SECONDS = 0.25
"""A page that has not changed for so long is at rest, and its image is refined."""
REFINEMENT = 2.0
"""Factor of the side from one refinement to the next: the last one takes most of the time."""
MEASURED_SECONDS = 2.0
"""Time over which frames per second are counted."""


@dataclass(frozen=True)
class FrameRequest:
    """A frame that a page waits for."""

    state: ViewState
    version: int
    scale: float
    """Side of the frame, relative to that at rest."""


class Viewport:
    """The newest state of one page, and how far it is rendered.

    The page's threads change the state; the thread that owns the models asks what is ``wanted`` and
    delivers it. Images are encoded and sent by a thread of the viewport's own, and nothing more is
    rendered until that is done: a slow page gets fewer frames, and nobody waits for it.
    """

    def __init__(
        self, state: ViewState, send: Callable[[Frame, bool], None], wake: Callable[[], None]
    ) -> None:
        """Show ``state``.

        Args:
            state: the first state.
            send: encodes and sends a frame; receives true if the page is at rest.
            wake: tells the thread that owns the models that something is wanted.
        """
        self.playback = Playback()
        self._flight: Flight | None = None
        self.closed = False
        self.problem: Callable[[str], None] = lambda text: None
        """Tells the page why its state cannot be rendered."""
        self._state, self._version, self._changed = state, 0, float("-inf")
        self._rendered, self._scale = -1, 0.0
        self._budget = FrameBudget()
        self._send, self._wake = send, wake
        self._lock = threading.Lock()
        self._sender = ThreadPoolExecutor(1, "viewer-send")
        self._sending = False
        self._sent: deque[float] = deque(maxlen=200)
        self._failed: tuple[ViewState, str] | None = None
        self.last_frame: Frame | None = None

    @property
    def state(self) -> ViewState:
        """The newest state."""
        return self._state

    def change(self, edit: Callable[[ViewState], ViewState]) -> None:
        """Change the state by a function of it; an equal state is no change."""
        with self._lock:
            state = edit(self._state)
            if state == self._state:
                return
            self._state, self._changed = state, time.monotonic()
            self._version += 1
        self._wake()

    def refresh(self) -> None:
        """Render the state again, as the model has changed; at rest, at the full size."""
        with self._lock:
            self._version += 1
        self._wake()

    def play(self, playing: bool) -> None:
        """Start or stop the playback; from the start if it is at its end."""
        self.playback.play(playing)
        if playing and self._state.time >= 1.0:
            self.change(lambda state: replace(state, time=0.0))
        self._wake()

    def fly(self, path: PathStates) -> None:
        """Fly along a path once, then return to where the page is."""
        self._flight = Flight(path, self._state)
        self._wake()

    def land(self) -> None:
        """End a flight where it is, as the page moves by itself."""
        self._flight = None

    def _advance(self, now: float) -> bool:
        """Move on with the playback or the flight; false if nothing plays."""
        if self._flight is not None:
            flight = self._flight
            self.change(lambda state: flight.state(state, now))
            if flight.ended:
                self._flight = None
            return True
        if self.playback.playing:
            moment = self.playback.advance(self._state.time, now)
            self.change(lambda state: replace(state, time=moment))
            return True
        return False

    def wanted(self, now: float, seconds: float) -> FrameRequest | None:
        """The frame to render next; ``None`` while nothing is to be done.

        Args:
            now: the monotonic clock.
            seconds: time that a frame may take while the page moves.
        """
        if self.closed or self._sending:
            return None
        playing = self._advance(now)
        with self._lock:
            state, version = self._state, self._version
            resting = now - self._changed > REST_SECONDS and not playing
        width, height = state.full_size()
        moving_scale = self._budget.scale(width * height, seconds)
        if version != self._rendered:
            # Where only the model has changed, an image at rest stays as sharp as it was.
            scale = max(moving_scale, self._scale) if resting else moving_scale
            return FrameRequest(state, version, scale)
        if resting and self._scale < 1.0:
            return FrameRequest(state, version, min(1.0, REFINEMENT * self._scale))
        return None

    def deliver(self, request: FrameRequest, frame: Frame) -> None:
        """Take a rendered frame, and send it in the viewport's own thread."""
        height, width = frame.image.shape[:2]
        self._budget.observe(height * width, frame.seconds)
        with self._lock:
            self._rendered, self._scale = request.version, request.scale
            still = time.monotonic() - self._changed > REST_SECONDS and request.scale == 1.0
            if self.closed:
                return
            self._sending = True
            self._sender.submit(self._send_now, frame, still)  # Not after close() shut it down.

    def fail(self, request: FrameRequest, text: str) -> None:
        """Note that a state cannot be rendered; the page is told once for each state."""
        with self._lock:
            self._rendered, self._scale = request.version, 1.0
            known, self._failed = self._failed == (request.state, text), (request.state, text)
        if not known:  # A model that trains makes the page render its state again and again.
            self.problem(text)

    @property
    def sending(self) -> bool:
        """True while a frame is on its way."""
        return self._sending

    def _send_now(self, frame: Frame, still: bool) -> None:
        try:
            if not self.closed:
                self._send(frame, still)
                self.last_frame = frame
                self._sent.append(time.monotonic())
        except Exception as error:  # The page was closed in mid-frame; there is nobody to tell.
            logger.debug("a frame was not sent: %s", error)
        finally:
            self._sending = False
            self._wake()

    @property
    def resting(self) -> bool:
        """True if the page has its state at the full size, and nothing plays."""
        playing = self.playback.playing or self._flight is not None
        return self._scale == 1.0 and self._rendered == self._version and not playing

    def frames_per_second(self) -> float:
        """Frames sent per second, over the last seconds."""
        since = time.monotonic() - MEASURED_SECONDS
        return sum(moment > since for moment in tuple(self._sent)) / MEASURED_SECONDS

    def close(self) -> None:
        """Want nothing any more."""
        with self._lock:
            self.closed = True
            self._sender.shutdown(wait=False, cancel_futures=True)
        self._wake()
