"""Interrupt: Ctrl-C ends a run after its step, with a checkpoint; a second one ends it at once."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from gsfw.core.callback import Control

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@dataclass
class Interrupt:
    """Whether a signal has asked the run to stop."""

    received: bool = False


@contextmanager
def stop_on_signal(control: Control) -> Iterator[Interrupt]:
    """Let the first signal ask the run to stop, and the second raise ``KeyboardInterrupt``."""
    interrupt = Interrupt()

    def stop(number: int, frame: FrameType | None) -> None:
        if interrupt.received:
            raise KeyboardInterrupt
        interrupt.received = True
        name = signal.Signals(number).name
        control.request_stop(f"interrupted by {name}")
        sys.stderr.write("\nstopping after this step, with a checkpoint; once more stops at once\n")

    before = {number: signal.signal(number, stop) for number in SIGNALS}
    try:
        yield interrupt
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
