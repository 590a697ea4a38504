"""Guard: runs a command line, and ends it when the program that has started the guard ends.

It is a script of the standard library alone, so that it starts in milliseconds.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from types import FrameType

PATIENCE = 30.0
"""Seconds for writing a checkpoint, as of ``JobProcess``."""

PR_SET_PDEATHSIG = 1
"""Linux's option of ``prctl``: a process gets a signal when its parent ends."""


def main(command: list[str]) -> int:
    """Run a command line to its end; standard input is a pipe that the starter holds open."""
    asked = threading.Event()
    running: list[subprocess.Popen[bytes]] = []

    def stop(number: int, frame: FrameType | None) -> None:
        asked.set()
        for process in running:
            process.send_signal(number)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, stop)
    if hasattr(signal, "pthread_sigmask"):  # Not on Windows.
        # Ray's processes block SIGINT, and those that they start inherit that.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    # There is no other thread yet.
    child = subprocess.Popen(command, stdin=subprocess.DEVNULL, preexec_fn=_end_with_guard)  # noqa: PLW1509
    running.append(child)
    if asked.is_set():
        child.terminate()
    threading.Thread(target=_watch, args=(child,), daemon=True).start()
    code = child.wait()
    if code < 0:  # Ended by a signal: so is the guard.
        number = signal.Signals(-code)
        if number is not signal.SIGKILL:
            signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
    return code


def _end_with_guard() -> None:
    """Ask the process to end when the guard is killed: Ray kills what its workers have started."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def _watch(child: subprocess.Popen[bytes]) -> None:
    # It ends with the starter, however that ended. (A thread would hold the lock of sys.stdin.)
    while os.read(0, 1):
        pass
    child.terminate()
    time.sleep(PATIENCE)
    child.kill()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
