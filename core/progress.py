"""Progress: long work in the library says how far it is; a command decides how that is shown.

The library never prints. It wraps work that may take over a second::

    for path in tracked(paths, "reading images", len(paths)):
        ...

Nothing is shown unless somebody watches, with ``shown_by``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TypeVar

Advance = Callable[[int], None]
"""Takes the number of things that are done so far."""

ShowStage = Callable[[str, int], AbstractContextManager[Advance]]
"""Shows a stage while it runs.

Takes the work in words ("reading images") and the number of things, 0 if it is unknown.
"""

Item = TypeVar("Item")

_watchers: list[ShowStage] = []


@contextmanager
def shown_by(show: ShowStage) -> Iterator[None]:
    """Let ``show`` display all stages from now on; afterwards the former watcher again."""
    _watchers.append(show)
    try:
        yield
    finally:
        _watchers.remove(show)


@contextmanager
def stage(name: str, total: int = 0) -> Iterator[Advance]:
    """A piece of work that may take over a second.

    Args:
        name: the work in words, such as "reading images".
        total: number of things to do; 0 if it is unknown.

    Yields:
        A function to call with the number of things that are done.
    """
    if not _watchers:
        yield lambda done: None
        return
    with _watchers[-1](name, total) as advance:
        yield advance


def tracked(items: Iterable[Item], name: str, total: int) -> Iterator[Item]:
    """The items of a loop that is a stage: an item is done when the next one is asked for.

    Args:
        items: the work of the loop, or the loop's own slow results.
        name: the work in words.
        total: number of items; 0 if it is unknown.
    """
    with stage(name, total) as advance:
        for done, item in enumerate(items, start=1):
            yield item
            advance(done)
