"""Console: text for people, and the one JSON document of a verb for programs."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from shutil import get_terminal_size
from typing import Any

from gsfw.core.files.json_text import json_text
from gsfw.core.notebook import is_notebook

WIDTH_OF_FILES = 160
"""Width of a table without a terminal, in columns."""
USUAL_WIDTH = 80
"""Width of a terminal that does not know its own."""
LEAST_WIDTH = 20
"""Narrower terminals have to wrap lines themselves."""


class LoggedWarnings(logging.Handler):
    """Prints the logged warnings of all parts of gsfw, without their tracebacks."""

    def __init__(self, console: Console) -> None:
        super().__init__(logging.WARNING)
        self._console = console

    def emit(self, record: logging.LogRecord) -> None:
        """Print one warning."""
        self._console.warn(record.getMessage())

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Print warnings inside the context of one verb."""
        logger = logging.getLogger("gsfw")
        logger.addHandler(self)
        try:
            yield
        finally:
            logger.removeHandler(self)


class Console:
    """Standard output: text for people, or, with ``json=true``, one document and nothing else."""

    def __init__(self, json_only: bool = False) -> None:
        self.json_only = json_only

    def say(self, text: str = "") -> None:
        """Print a line; on standard error if standard output belongs to a program."""
        stream = sys.stderr if self.json_only else sys.stdout
        stream.write(f"{text}\n")
        stream.flush()

    def warn(self, text: str) -> None:
        """Print a line on standard error."""
        sys.stderr.write(f"warning: {text}\n")

    def table(self, columns: Sequence[str], rows: Iterable[Sequence[str]], title: str = "") -> None:
        """Print a table; nothing with ``json=true``."""
        if not self.json_only:
            self.say(render_table(columns, rows, title))

    def result(self, document: Mapping[str, Any] | Sequence[Any]) -> None:
        """Print the document with ``json=true``; call it once, at the end."""
        if self.json_only:
            sys.stdout.write(json_text(document, indent=1) + "\n")
            sys.stdout.flush()


class ProgramConsole(Console):
    """The console of a Python program that calls gsfw: standard output and results are its own."""

    def __init__(self, is_quiet: bool = False) -> None:
        """Print for people, unless the program wants quiet."""
        super().__init__()
        self._is_quiet = is_quiet

    def say(self, text: str = "") -> None:
        """Print a line on standard error; in a notebook on standard output, which is not red."""
        if not self._is_quiet:
            stream = sys.stdout if is_notebook() else sys.stderr
            stream.write(f"{text}\n")
            stream.flush()

    def warn(self, text: str) -> None:
        """Print a line on standard error."""
        if not self._is_quiet:
            super().warn(text)

    def result(self, document: Mapping[str, Any] | Sequence[Any]) -> None:
        """Print nothing: functions return their results."""


def screen_width() -> int:
    """Columns of the terminal behind standard output; ``WIDTH_OF_FILES`` where there is none."""
    # While a bar is displayed, an object of rich stands in for the stream, which is no terminal.
    stream = getattr(sys.stdout, "rich_proxied_file", sys.stdout)
    if not stream.isatty():
        return WIDTH_OF_FILES
    return max(get_terminal_size((USUAL_WIDTH, 24)).columns, LEAST_WIDTH)


def heading(text: str) -> str:
    """A line in bold type; plain where standard output is no terminal."""
    from rich.console import Console as Screen
    from rich.text import Text

    screen = Screen(width=screen_width())
    with screen.capture() as captured:
        screen.print(Text(text, style="bold"))
    return captured.get().rstrip("\n")


def render_table(columns: Sequence[str], rows: Iterable[Sequence[str]], title: str = "") -> str:
    """Format a table as text, as wide as the terminal; the last column wraps.

    Args:
        columns: headings; all empty for none.
        rows: cells.
        title: a line above.
    """
    from rich.console import Console as Screen
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_header=any(columns))
    for index, column in enumerate(columns):
        table.add_column(column, header_style="bold", no_wrap=index < len(columns) - 1)
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    screen = Screen(width=screen_width())
    with screen.capture() as captured:
        screen.print(table)
    lines = [line.rstrip() for line in captured.get().splitlines()]
    return "\n".join([heading(title), *lines] if title else lines)
