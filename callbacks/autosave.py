"""Autosave: writes a checkpoint every few minutes, so that a killed run loses little."""

from __future__ import annotations

import time
from pathlib import Path

from gsfw.core.callback import Callback, Control, RunInfo


class Autosave(Callback):
    """Requests a checkpoint when the latest one is too old."""

    def __init__(self, seconds: float) -> None:
        """Keep the latest checkpoint younger than ``seconds``."""
        self._seconds = seconds
        self._last = time.monotonic()

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Start the clock."""
        self._last = time.monotonic()

    def on_tick(self, step: int, control: Control) -> None:
        """Request a checkpoint if the latest one is too old."""
        if time.monotonic() - self._last >= self._seconds:
            control.request_checkpoint()

    def on_checkpoint(self, step: int, path: Path) -> None:
        """Restart the clock."""
        self._last = time.monotonic()
