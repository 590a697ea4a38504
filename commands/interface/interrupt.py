"""Interrupt: effects of signals.

Ctrl-C ends a run after its step, with a checkpoint; a second one ends it immediately. SIGTERM, and
SIGHUP at the end of a terminal, end it after its step, however often they come. Elsewhere a signal
ends the program like an error, so that temporary files are removed; during an import it waits for
the end of the import, for some seconds at most.
"""

from __future__ import annotations

import _thread
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from types import FrameType
from typing import TYPE_CHECKING

from gsfw.core.errors import EndedBySignal

if TYPE_CHECKING:
    from gsfw.core.callback import Control

ENDING = tuple(signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end a program; Windows has no SIGHUP."""

SIGNALS = (signal.SIGINT, *ENDING)
"""Signals that end a run after its step."""

AGAIN = 0.05
"""Seconds until a signal that cannot end the program yet is tried again."""

PATIENCE = 15.0
"""Seconds after which a signal no longer waits for imports: a module may hang in one."""

Handler = Callable[[int, FrameType | None], None]


@dataclass
class Interrupt:
    """True if a signal has requested a stop of the run."""

    received: bool = False


def unclaimed_signals() -> tuple[signal.Signals, ...]:
    """SIGINT where it would raise ``KeyboardInterrupt``: the signal that gsfw may take over.

    A program has handlers of its own, and threads but the main one cannot set any.
    """
    is_main = threading.current_thread() is threading.main_thread()
    handler = signal.getsignal(signal.SIGINT)
    # In a verb of a plugin, which may train with gsfw.train, it is the handler of the command line.
    is_free = handler in (signal.default_int_handler, _AfterImports(_leave))
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
        is_key = number == signal.SIGINT
        control.request_stop(
            f"interrupted by {'Ctrl-C' if is_key else signal.Signals(number).name}"
        )
        if not is_quiet:
            _say("\nstopping after this step, with a checkpoint; Ctrl-C once more stops at once\n")

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
            _say(f"\n{text}\n")
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, _AfterImports(stop))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def leave_on_signal() -> Iterator[None]:
    """Raise an exception at each signal that ends a program.

    It is ``KeyboardInterrupt`` at SIGINT, else ``EndedBySignal`` with 128 + the number. By default
    Python would end immediately, without removing temporary files.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # Other threads cannot set handlers.
        return
    before = {
        number: signal.signal(number, _AfterImports(_leave))
        for number in SIGNALS
        # nohup ignores SIGHUP, and a shell SIGINT for what it starts in the background.
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler)
    }
    try:
        with _destructors_interruptible():
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _leave(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt if number == signal.SIGINT else EndedBySignal(128 + number)


@dataclass
class _AfterImports:
    """A handler that waits until the imports that a signal interrupts have ended.

    Modules swallow the exceptions of what they import, and numpy and torch can be imported only
    once: an exception would be lost, or become another one.
    """

    handler: Handler
    outer: int = field(default_factory=lambda: _imports(sys._getframe()), compare=False)
    """Imports that wait for the program itself, such as that of a script that calls it."""
    since: float = field(default=math.inf, compare=False)
    """Time of the first signal that waits; infinity if none does."""

    def __call__(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        self.since = min(self.since, now)
        is_late = now - self.since >= PATIENCE
        if _imports(frame) > self.outer and not is_late and _repeat(number):
            return
        self.since = math.inf
        self.handler(number, frame)


def _imports(frame: FrameType | None) -> int:
    """Number of frames of Python's import system below and including a frame."""
    count = 0
    while frame is not None:
        count += frame.f_code.co_filename.startswith("<frozen importlib")
        frame = frame.f_back
    return count


def _repeat(number: int) -> bool:
    """Send this process a signal again after a while; false if that is impossible."""
    program = threading.get_ident()  # Handlers run in the main thread.

    def send() -> None:
        time.sleep(AGAIN)
        if sys.platform == "win32":
            _thread.interrupt_main(signal.Signals(number))
        else:  # Ends a wait of the main thread, too.
            signal.pthread_kill(program, number)

    try:
        _thread.start_new_thread(send, ())  # The locks of ``threading`` may be held.
    except RuntimeError:  # The system allows no more threads.
        return False
    return True


@contextmanager
def _destructors_interruptible() -> Iterator[None]:
    """Repeat a signal whose exception is lost in a destructor or another callback of Python."""
    before = sys.unraisablehook

    def report(lost: sys.UnraisableHookArgs) -> None:
        error, number = lost.exc_value, None
        if isinstance(error, KeyboardInterrupt):
            number = int(signal.SIGINT)
        elif isinstance(error, EndedBySignal):
            number = error.code - 128
        if number is None or not _repeat(number):
            before(lost)

    sys.unraisablehook = report
    try:
        yield
    finally:
        sys.unraisablehook = before


def _say(text: str) -> None:
    """Print a text from a handler, which may have interrupted a write to the same stream."""
    try:
        sys.stderr.write(text)
        sys.stderr.flush()
    except RuntimeError:  # The buffer is in use.
        with suppress(OSError):
            os.write(2, text.encode())
