"""Progress: what long work tells whoever waits for it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Advance = Callable[[int], None]
"""Told how many things are done by now."""


class Progress(ABC):
    """Shows how far each stage is."""

    @abstractmethod
    @contextmanager
    def stage(self, name: str, total: int) -> Iterator[Advance]:
        """Show a stage while it runs.

        Args:
            name: what is done, such as "features".
            total: how many things there are; work may end with fewer.
        """

    @abstractmethod
    def say(self, text: str) -> None:
        """A line about what was chosen or found."""


class Silent(Progress):
    """Shows nothing."""

    @contextmanager
    def stage(self, name: str, total: int) -> Iterator[Advance]:
        """Count without showing it."""
        yield lambda done: None

    def say(self, text: str) -> None:
        """Nothing."""
