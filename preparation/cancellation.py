"""Cancellation: long work in native code that Ctrl-C can still end."""

from __future__ import annotations

from collections.abc import Callable
from threading import Thread
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

    def run() -> None:
        try:
            results.append(work(token))
        except BaseException as error:
            failures.append(error)

    thread = Thread(target=run, daemon=True)
    thread.start()
    try:
        while thread.is_alive():
            thread.join(PATIENCE)
    except BaseException:
        token.cancel()
        thread.join()
        raise
    if failures:
        raise failures[0]
    return results[0]
