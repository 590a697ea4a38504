"""StageBars: the stages of long work as bars on a terminal, as lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gsfw.commands.interface.console import Console
from gsfw.preparation.progress import Advance, Progress

EVERY = 30.0
"""Seconds between lines where there is no terminal."""


class StageBars(Progress):
    """Bars with the time that is left, and a line for each stage that has ended."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def say(self, text: str) -> None:
        """A line."""
        self._console.say(text)

    @contextmanager
    def stage(self, name: str, total: int) -> Iterator[Advance]:
        """Show a bar, or a line now and then; a line with its time when the stage is done."""
        start = time.perf_counter()
        counted = _Counted()
        with self._bar(name, total) if sys.stderr.isatty() else self._lines(name, total) as show:

            def advance(done: int) -> None:
                counted.done = done
                show(done)

            yield advance
        seconds = time.perf_counter() - start
        self.say(f"{name}: {counted.done} of {total} in {seconds:.1f} s")

    @contextmanager
    def _bar(self, name: str, total: int) -> Iterator[Advance]:
        from rich.console import Console as Screen
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )
        from rich.progress import Progress as Bars

        columns = (
            *(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()),
            *(TimeElapsedColumn(), TextColumn("left:"), TimeRemainingColumn()),
        )
        with Bars(*columns, console=Screen(stderr=True), transient=True) as bars:
            task = bars.add_task(name, total=total)
            yield lambda done: bars.update(task, completed=done)

    @contextmanager
    def _lines(self, name: str, total: int) -> Iterator[Advance]:
        start = last = time.perf_counter()

        def advance(done: int) -> None:
            nonlocal last
            now = time.perf_counter()
            if now - last >= EVERY and 0 < done < total:
                last = now
                left = (now - start) * (total - done) / done
                self.say(f"{name}: {done} of {total}, about {left:.0f} s left")

        yield advance


class _Counted:
    """The number of finished things."""

    done = 0


def with_progress(files: Iterator[Path], total: int, name: str) -> list[Path]:
    """Write all, with a bar on a terminal; the files."""
    from rich.console import Console as Screen
    from rich.progress import track

    screen = Screen(stderr=True)
    if not screen.is_terminal:
        return list(files)
    return list(track(files, description=name, total=total, console=screen))
