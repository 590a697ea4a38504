"""What stages of work report, for tests of them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gsfw.core.progress import Advance


def interrupt() -> None:
    raise KeyboardInterrupt


class WatchedStages:
    """Keeps what is reported, and interrupts the work when so many items are done."""

    def __init__(self, at: int = -1, interrupt: Callable[[], None] = interrupt) -> None:
        self._at, self._interrupt = at, interrupt
        self.stages: list[tuple[str, int]] = []
        self.done: list[int] = []

    @contextmanager
    def show(self, name: str, total: int) -> Iterator[Advance]:
        self.stages.append((name, total))
        yield self._advance

    def _advance(self, done: int) -> None:
        self.done.append(done)
        if done == self._at:
            self._interrupt()
