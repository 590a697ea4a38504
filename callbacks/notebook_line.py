"""NotebookLine: the figures of a running training as one output of a notebook's cell."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape

from gsfw.callbacks.live_line import GAP, Figures
from gsfw.core.notebook import Output
from gsfw.core.progress import Advance

SECONDS = 0.3
"""Between updates of the output: each is a message to the page."""


class NotebookLine:
    """A bar, the figures, and other work than steps; empty once the run has ended."""

    def __init__(self, figures: Figures) -> None:
        """Show the figures, which change in place."""
        self._figures = figures
        self._stage = ""
        self._is_over = False
        self._refreshed = time.monotonic()
        self._output = Output(self)

    def refresh(self) -> None:
        """Show the present figures, unless they have just been shown."""
        now = time.monotonic()
        if now - self._refreshed >= SECONDS:
            self._refreshed = now
            self._output.refresh()

    @contextmanager
    def stage(self, name: str, total: int) -> Iterator[Advance]:
        """Show other work than steps (a ``ShowStage`` of ``core.progress``)."""

        def advance(done: int) -> None:
            self._stage = f"{name}: {done} of {total}" if total else name
            self.refresh()

        self._stage = name
        self.refresh()
        try:
            yield advance
        finally:
            self._stage = ""

    def close(self) -> None:
        """Empty the output: the summary of the run takes its place."""
        self._is_over = True
        self._output.refresh()

    def __repr__(self) -> str:
        if self._is_over:
            return ""
        return GAP.join(part for _, part in self._figures.parts(is_short=False)).lstrip()

    def _repr_html_(self) -> str:
        """One line; the last one is empty."""
        if self._is_over:
            return "<span></span>"
        figures, text = self._figures, repr(self)
        stage = f"<br>{escape(self._stage)}" if self._stage else ""
        return (
            f'<progress value="{figures.step}" max="{max(figures.steps, 1)}"></progress> '
            f'<span style="white-space:pre">{escape(text)}</span>{stage}'
        )
