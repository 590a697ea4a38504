"""FrameService: serves all pages on the one thread that owns the models."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Generator, Sequence

import torch

from gsfw.core.errors import UserError
from gsfw.core.loop.full_memory import shortage
from gsfw.viewer.frame import FrameMaker
from gsfw.viewer.viewed_model import ViewedModel
from gsfw.viewer.viewport import Viewport

logger = logging.getLogger(__name__)

MOVING_SECONDS = 1 / 20
"""Time that a frame may take while a page moves, if nothing else needs the machine."""
SMALLER = "Make the window smaller, or start the viewer with fewer Gaussians (budget=500000)."
"""Remedy for a page whose frames do not fit into a GPU."""
NAP_SECONDS = 0.05
"""Longest sleep of an idle service: then pages may have come to rest."""

Task = Generator[None, None, None]
"""Longer work that a page has ordered, in parts that take as long as a frame."""


class FrameService:
    """Renders what pages want, in turns, and works off their tasks.

    No other thread touches the models, so that nothing is locked, copied or waited for.
    """

    def __init__(self, models: Sequence[ViewedModel]) -> None:
        """Serve pages that show these models."""
        self.moving_seconds = MOVING_SECONDS
        self.maker = FrameMaker(models)
        self._viewports: list[Viewport] = []
        self._tasks: deque[Task] = deque()
        self._woken = threading.Event()
        self._lock = threading.Lock()
        self._turn, self._after_frame = 0, False

    def add(self, viewport: Viewport) -> None:
        """Serve one more page."""
        with self._lock:
            self._viewports.append(viewport)
        self.wake()

    def remove(self, viewport: Viewport) -> None:
        """Serve a page no more."""
        viewport.close()
        with self._lock:
            self._viewports = [other for other in self._viewports if other is not viewport]

    @property
    def pages(self) -> int:
        """Number of open pages."""
        return len(self._viewports)

    @property
    def sending(self) -> bool:
        """True while a frame is on its way to a page, in a thread beside this one."""
        return any(viewport.sending for viewport in tuple(self._viewports))

    def order(self, task: Task) -> None:
        """Work off a task between frames; it is advanced to its end, part by part."""
        with self._lock:
            self._tasks.append(task)
        self.wake()

    @property
    def has_orders(self) -> bool:
        """True if there is a task that is not done."""
        return bool(self._tasks)

    def close(self) -> None:
        """Give up the tasks that are not done; they remove what they have begun."""
        while self._tasks:
            self._tasks.popleft().close()

    def wake(self) -> None:
        """Note that there may be work; any thread may call this."""
        self._woken.set()

    def wait(self, seconds: float = NAP_SECONDS) -> None:
        """Sleep until there may be work, at most so long."""
        self._woken.wait(seconds)
        self._woken.clear()

    def refresh(self) -> None:
        """Render every page again: the model has changed."""
        for viewport in tuple(self._viewports):
            viewport.refresh()

    def serve_one(self) -> bool:
        """Render one frame, or do one part of a task; false if there was nothing to do."""
        if self._after_frame and self._advance_task():  # A page that plays starves no task.
            self._after_frame = False
            return True
        self._after_frame = self.serve_frame()
        return self._after_frame or self._advance_task()

    def serve_frame(self) -> bool:
        """Render one frame; false if no page wants one."""
        viewports = tuple(self._viewports)
        now = time.monotonic()
        for place in range(len(viewports)):
            viewport = viewports[(self._turn + place) % len(viewports)]
            if self._serve(viewport, now):
                self._turn += place + 1  # The next page has the next turn.
                return True
        return False

    def _serve(self, viewport: Viewport, now: float) -> bool:
        request = viewport.wanted(now, self.moving_seconds)
        if request is None:
            return False
        try:
            frame = self.maker.make(request.state, request.scale)
        except UserError as error:
            viewport.fail(request, f"{error.message} {error.advice}".strip())
        except torch.OutOfMemoryError as error:
            viewport.fail(request, f"The GPU's memory is full{shortage(error)}. {SMALLER}")
        except Exception as error:
            # One page's wish is no reason to end a run, or the view of others.
            logger.debug("a frame failed", exc_info=True)
            viewport.fail(request, f"This cannot be rendered: {type(error).__name__}: {error}")
        else:
            viewport.deliver(request, frame)
        return True

    def _advance_task(self) -> bool:
        if not self._tasks:
            return False
        task = self._tasks[0]
        try:
            next(task)
            self._tasks.rotate(-1)
            return True
        except StopIteration:
            pass
        except Exception:
            logger.warning("an order from the viewer's page failed", exc_info=True)
        self._tasks.remove(task)
        return True
