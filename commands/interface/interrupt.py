"""Interrupt: effects of signals.

Ctrl-C ends a run after its step, with a checkpoint; a second one ends it immediately. SIGTERM, and
SIGHUP at the end of a terminal, end it after its step, however often they come. Elsewhere a signal
ends the program like an error, so that temporary files are removed.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING

from gsfw.core.errors import EndedBySignal

if TYPE_CHECKING:
    from gsfw.core.callback import Control

ENDING = tuple(signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end a program; Windows has no SIGHUP."""

SIGNALS = (signal.SIGINT, *ENDING)
"""Signals that end a run after its step."""


@dataclass
class Interrupt:
    """True if a signal has requested a stop of the run."""

    received: bool = False


def unclaimed_signals() -> tuple[signal.Signals, ...]:
    """SIGINT where it would raise ``KeyboardInterrupt``: the signal that gsfw may take over.

    A program has handlers of its own, and threads but the main one cannot set any.
    """
    is_main = threading.current_thread() is threading.main_thread()
    is_free = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    return (signal.SIGINT,) if is_main and is_free else ()


@contextmanager
def stop_on_signal(
    control: Control, signals: Sequence[signal.Signals] = SIGNALS, is_quiet: bool = False
) -> Iterator[Interrupt]:
    """Request a stop of the run at the first signal; raise ``KeyboardInterrupt`` at a later SIGINT.

    A later SIGTERM or SIGHUP changes nothing: a scheduler and the death of the parent process may
    both send one, and neither means that the checkpoint is to be lost. An ignored SIGHUP stays
    ignored, as nohup asks for that.

    Args:
        control: takes the request.
        signals: that request it.
        is_quiet: true to print nothing, as another process does.
    """
    interrupt = Interrupt()

    def stop(number: int, frame: FrameType | None) -> None:
        if interrupt.received:
            if number == signal.SIGINT:
                raise KeyboardInterrupt
            return
        interrupt.received = True
        name = signal.Signals(number).name
        control.request_stop(f"interrupted by {name}")
        if not is_quiet:
            sys.stderr.write("\nstopping after this step, with a checkpoint; ")
            sys.stderr.write("Ctrl-C once more stops at once\n")
            sys.stderr.flush()

    before = {
        number: signal.signal(number, stop)
        for number in signals
        if number in (signal.SIGINT, signal.SIGTERM)
        or signal.getsignal(number) is not signal.SIG_IGN
    }
    try:
        yield interrupt
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def interrupted_once(text: str) -> Iterator[None]:
    """Print a line and raise ``KeyboardInterrupt`` at the first Ctrl-C; ignore further ones.

    This is for work that takes seconds to stop, and that a second signal would corrupt.
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
    """Raise ``EndedBySignal`` with 128 + its number at each signal that ends a program.

    By default Python would end immediately, without removing temporary files.
    """

    def leave(number: int, frame: FrameType | None) -> None:
        raise EndedBySignal(128 + number)

    before = {}
    if threading.current_thread() is threading.main_thread():  # Other threads cannot set handlers.
        for number in ENDING:
            if signal.getsignal(number) is signal.SIG_DFL:  # nohup ignores SIGHUP.
                before[number] = signal.signal(number, leave)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
