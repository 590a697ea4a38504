"""Progress: the library reports the progress of long work; a command displays it.

The library never prints. It wraps work that may take over a second::

    for path in tracked(paths, "reading images", len(paths)):
        ...

Nothing is displayed outside of ``shown_by``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TypeVar

Advance = Callable[[int], None]
"""Receives the number of finished items."""

ShowStage = Callable[[str, int], AbstractContextManager[Advance]]
"""Displays a stage while it runs.

Receives the work in words ("reading images") and the number of items, 0 if it is unknown.
"""

Item = TypeVar("Item")

_watchers: list[ShowStage] = []


@contextmanager
def shown_by(show: ShowStage) -> Iterator[None]:
    """Display all stages with ``show`` inside the context; then restore the former display."""
    _watchers.append(show)
    try:
        yield
    finally:
        _watchers.remove(show)


@contextmanager
def stage(name: str, total: int = 0) -> Iterator[Advance]:
    """Report work that may take over a second.

    Args:
        name: the work in words, such as "reading images".
        total: number of items; 0 if it is unknown.

    Yields:
        A function that receives the number of finished items.
    """
    if not _watchers:
        yield lambda done: None
        return
    with _watchers[-1](name, total) as advance:
        yield advance


def tracked(items: Iterable[Item], name: str, total: int) -> Iterator[Item]:
    """Iterate over the items of a stage: an item is finished when the next one is requested.

    Args:
        items: the items of the loop, or its slow results.
        name: the work in words.
        total: number of items; 0 if it is unknown.
    """
    with stage(name, total) as advance:
        for done, item in enumerate(items, start=1):
            yield item
            advance(done)
