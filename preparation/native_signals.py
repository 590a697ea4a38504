"""Native signals: what ends a program stays Python's to handle, although COLMAP would take it."""

from __future__ import annotations

import signal
import threading
from types import FrameType


def load_colmap() -> None:
    """Import pycolmap, and leave the signals that end a program as they were.

    By itself the import makes SIGTERM print a stack trace and end the program at once, without
    the cleaning up that Python's handlers allow; and it fails when Ctrl-C comes in its midst.

    Raises:
        ImportError, RuntimeError: it is not installed, or does not fit the machine.
        KeyboardInterrupt: after the import, if Ctrl-C came.
    """
    if threading.current_thread() is not threading.main_thread():
        import pycolmap  # Others cannot set handlers.

        return
    came: list[int] = []

    def remember(number: int, frame: FrameType | None) -> None:
        came.append(number)

    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    if before[signal.SIGINT] is signal.default_int_handler:
        signal.signal(signal.SIGINT, remember)
    try:
        import pycolmap  # noqa: F401 - to be loaded is all
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        raise KeyboardInterrupt
