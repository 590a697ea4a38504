"""Autosave: a checkpoint every few minutes, so that little is lost when a run is killed."""

from __future__ import annotations

import time
from pathlib import Path

from gsfw.core.callback import Callback, Control, RunInfo


class Autosave(Callback):
    """Asks for a checkpoint when the last one is too old."""

    def __init__(self, seconds: float) -> None:
        """Keep checkpoints younger than ``seconds``."""
        self._seconds = seconds
        self._last = time.monotonic()

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Start the clock."""
        self._last = time.monotonic()

    def on_tick(self, step: int, control: Control) -> None:
        """Look at the clock."""
        if time.monotonic() - self._last >= self._seconds:
            control.request_checkpoint()

    def on_checkpoint(self, step: int, path: Path) -> None:
        """Start the clock again."""
        self._last = time.monotonic()
