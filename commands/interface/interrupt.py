"""Interrupt: what signals do.

Ctrl-C ends a run after its step, with a checkpoint; a second one ends it at once. Elsewhere a
signal ends the program as an error does, so that it still removes what is temporary.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gsfw.core.callback import Control

SIGNALS = (signal.SIGINT, signal.SIGTERM)

ENDING = tuple(signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end a program; Windows has no SIGHUP."""


@dataclass
class Interrupt:
    """True if a signal has asked the run to stop."""

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


@contextmanager
def interrupted_once(text: str) -> Iterator[None]:
    """Let the first Ctrl-C say a line and raise ``KeyboardInterrupt``, and further ones do nothing.

    This is for work that takes seconds to stop, which a second one could only spoil.
    """
    interrupt = Interrupt()

    def stop(number: int, frame: FrameType | None) -> None:
        if not interrupt.received:
            interrupt.received = True
            sys.stderr.write(f"\n{text}\n")
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def leave_on_signal() -> Iterator[None]:
    """Let the signals that end a program raise ``SystemExit`` with 128 + their number.

    By itself Python ends on them at once, and what should have been removed at the end stays.
    """

    def leave(number: int, frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    before = {}
    if threading.current_thread() is threading.main_thread():  # Others cannot set handlers.
        for number in ENDING:
            if signal.getsignal(number) is signal.SIG_DFL:  # nohup has SIGHUP ignored.
                before[number] = signal.signal(number, leave)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
