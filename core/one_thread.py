"""One thread of torch: for work of many short operations, and for work in threads of its own.

Torch's threads would wait for one another in each operation: where other programs use the cores
too, that takes several times the processor time.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Lock, local

import torch


@dataclass
class _Work:
    """Work that is done now, and the threads of torch before the first of it.

    A new thread takes over the number that another one has set, so that the work itself cannot
    remember it.
    """

    calls: int = 0
    threads: int = 1


class _Own(local):
    """State of each thread."""

    is_inside: bool = False
    """True in work that it has begun: only the outermost counts."""


_work, _own, _LOCK = _Work(), _Own(), Lock()


@contextmanager
def one_thread() -> Iterator[int]:
    """Let torch use the calling thread alone. Threads that are started inside call this again.

    Yields:
        Threads that the work may start itself: its share of those that torch had.
    """
    if _own.is_inside:
        yield _share()
        return
    with _LOCK:
        if _work.calls == 0:
            _work.threads = torch.get_num_threads()
        _work.calls += 1
        torch.set_num_threads(1)
    _own.is_inside = True
    try:
        yield _share()
    finally:
        _own.is_inside = False
        with _LOCK:
            _work.calls -= 1
            torch.set_num_threads(_work.threads)


def _share() -> int:
    return max(1, _work.threads // max(1, _work.calls))
