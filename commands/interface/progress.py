"""Progress on the screen: stages of the library that take over a second, on standard error."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING

from gsfw.commands.interface.console import Console
from gsfw.core.notebook import is_notebook
from gsfw.core.progress import Advance, stage
from gsfw.core.words import duration, rough_duration

if TYPE_CHECKING:
    from rich.progress import Progress as Bars

PATIENCE = 0.7
"""Seconds before a stage is displayed: shorter waits need no explanation."""
FRAME = 0.1
"""Seconds between updates of a bar."""
LINES = 8.0
"""Seconds between lines without a terminal: with ``PATIENCE`` of the next stage, below ten."""


@contextmanager
def loading_torch(besides: str = "") -> Iterator[None]:
    """The stage in which torch is imported, which takes over a second; and more, in words.

    Modules stay until the end: the garbage collector looks at them neither now nor later. That
    saves a quarter of the processor time of ``gsfw train method=3dgs steps=1``.
    """
    is_loaded = "torch" in sys.modules  # By a program that has its own garbage, perhaps.
    with stage(f"loading torch{besides}"):
        if is_loaded or not gc.isenabled():
            yield
            return
        gc.disable()
        try:
            yield
            gc.freeze()
        finally:
            gc.enable()


def load_torch() -> None:
    """Import torch as a stage; checks without torch come before."""
    with loading_torch():
        import torch  # noqa: F401 - those who need it import it again, at once.


class SlowStages:
    """Displays each stage that takes over ``PATIENCE`` seconds.

    On a terminal these are bars, which are removed when the stage ends; elsewhere plain lines.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._bars: Bars | None = None

    @contextmanager
    def stage(self, name: str, total: int) -> Iterator[Advance]:
        """Display a stage (a ``ShowStage`` of ``core.progress``)."""
        counter = _Counter(name, total)
        ended = Event()
        show = self._show_bar if sys.stderr.isatty() else self._show_lines
        # A thread, since many long operations never return to Python in between.
        watcher = Thread(target=show, args=(counter, ended), name="gsfw-progress", daemon=True)
        watcher.start()
        try:
            yield counter.advance
        finally:
            ended.set()
            watcher.join()

    def _show_lines(self, counter: _Counter, ended: Event) -> None:
        wait = PATIENCE
        stream = sys.stdout if is_notebook() else sys.stderr  # Notebooks show errors in red.
        while not ended.wait(wait):
            stream.write(f"{counter}\n")
            stream.flush()
            wait = LINES

    def _show_bar(self, counter: _Counter, ended: Event) -> None:
        if ended.wait(PATIENCE):
            return
        with self._lock:
            if self._bars is None:
                self._bars = _new_bars()
                self._bars.start()
            bars = self._bars
            task = bars.add_task(counter.name, total=counter.total or None)
        while not ended.wait(FRAME):
            bars.update(task, completed=counter.done)
        with self._lock:
            bars.remove_task(task)
            if not bars.tasks:
                bars.stop()
                self._bars = None


class _Counter:
    """A stage and its progress."""

    def __init__(self, name: str, total: int) -> None:
        self.name, self.total, self.done = name, total, 0
        self._started = time.monotonic()

    def advance(self, done: int) -> None:
        self.done = done

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._started

    def __str__(self) -> str:
        seconds = self.seconds
        if not self.total:
            return f"{self.name}: {duration(seconds)} so far"
        if not 0 < self.done < self.total:  # Nothing to estimate from, or the end of the stage.
            return f"{self.name}: {self.done} of {self.total}"
        left = rough_duration(seconds * (self.total - self.done) / self.done)
        return f"{self.name}: {self.done} of {self.total}, about {left} left"


def _new_bars() -> Bars:
    from rich.console import Console as Screen
    from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    screen = Screen(stderr=True)
    spinner = SpinnerColumn("dots" if screen.encoding.startswith("utf") else "line")
    columns = (spinner, TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    # What is printed meanwhile belongs to standard output, wherever that goes.
    to_screen = sys.stdout.isatty()
    return Bars(*columns, console=screen, transient=True, redirect_stdout=to_screen)


class StageBars:
    """Displays stages as ``SlowStages`` does, with a bar at once and a line at the end of each."""

    def __init__(self, console: Console) -> None:
        self._console = console

    def say(self, text: str) -> None:
        """Print a line."""
        self._console.say(text)

    @contextmanager
    def stage(self, name: str, total: int) -> Iterator[Advance]:
        """Display a bar, or regular lines; print the duration at the end of the stage."""
        counter = _Counter(name, total)
        with self._bar(counter) if sys.stderr.isatty() else self._lines(counter):
            yield counter.advance
        of = f"{counter.done} of {total} in " if total else ""
        self.say(f"{name}: {of}{counter.seconds:.1f} s")

    @contextmanager
    def _bar(self, counter: _Counter) -> Iterator[None]:
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
        screen = Screen(stderr=True)
        with Bars(
            *columns, console=screen, transient=True, redirect_stdout=sys.stdout.isatty()
        ) as bars:
            task = bars.add_task(counter.name, total=counter.total or None)
            with _watched(lambda: bars.update(task, completed=counter.done), FRAME):
                yield

    @contextmanager
    def _lines(self, counter: _Counter) -> Iterator[None]:
        """Lines at regular times, whether or not anything advances."""
        with _watched(lambda: self.say(str(counter)), LINES):
            yield


@contextmanager
def _watched(show: Callable[[], None], seconds: float) -> Iterator[None]:
    """Call ``show`` every so many seconds from a thread: long work may never return to Python."""
    ended = Event()

    def watch() -> None:
        while not ended.wait(seconds):
            show()

    watcher = Thread(target=watch, name="gsfw-progress", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        ended.set()
        watcher.join()
