"""Cancellation: long work in native code that Ctrl-C can still end."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from pycolmap import CancellationToken

T = TypeVar("T")

PATIENCE = 0.1
"""Seconds between looks at whether a signal has come: Python handles them in its main thread."""


def cancellable(work: Callable[[CancellationToken], T]) -> T:
    """Do work in a thread; an exception in this one, such as Ctrl-C, cancels it and waits.

    Args:
        work: gets the token that it has to give to pycolmap.
    """
    from pycolmap import CancellationToken

    token = CancellationToken()
    results: list[T] = []
    failures: list[BaseException] = []
    begin, ended = Event(), Event()

    def run() -> None:
        begin.wait()
        try:
            results.append(work(token))
        except BaseException as error:
            failures.append(error)
        finally:
            ended.set()

    thread = Thread(target=run, daemon=True)
    # Ctrl-C while it starts leaves a thread that waits, and not one that works unseen.
    thread.start()
    try:
        begin.set()
        # Not ``join``: before Python 3.13, one that Ctrl-C breaks off takes the thread for ended.
        while not ended.wait(PATIENCE):
            pass
    except BaseException:
        token.cancel()
        # Native code that still works while the program ends would bring it down.
        while not ended.is_set():
            with suppress(KeyboardInterrupt, SystemExit):
                ended.wait(PATIENCE)
        raise
    if failures:
        raise failures[0]
    return results[0]


def end_with_parent() -> None:
    """End this process when its parent has ended, also by force.

    By itself a process of a pool would wait for work for ever, since it holds both ends of the
    queue that it is given work by.
    """

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=watch, daemon=True).start()
