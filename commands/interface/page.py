"""Page: help as text that fits the terminal, paragraphs and tables of options."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import zip_longest
from textwrap import fill, wrap

from gsfw.commands.interface.console import heading, screen_width

Row = tuple[str, str, str]
"""KEY=VALUE or a word, its type, its meaning."""

ROOM_FOR_COLUMNS = 100
"""Width from which options stand in columns; below, the meaning would have none left."""
MOST_NAME, MOST_TYPE = 36, 24
"""Widest columns of names and types: a longer name has a line of its own, a longer type wraps."""
GAP = "  "
INDENT = "    "
"""Before the meaning of an option that stands below its name."""


def paragraphs(text: str) -> str:
    """Fill the paragraphs that are wider than the screen; indented lines stay as they are."""
    width = screen_width()
    return "\n\n".join(_filled(part, width) for part in text.split("\n\n"))


def _filled(paragraph: str, width: int) -> str:
    lines = paragraph.splitlines()
    if max(map(len, lines), default=0) <= width or any(line.startswith(" ") for line in lines):
        return paragraph
    return fill(" ".join(lines), width, break_long_words=False, break_on_hyphens=False)


def option_table(rows: Sequence[Row], title: str = "", alike: Sequence[Row] = ()) -> str:
    """Lay out options as wide as the screen: in columns, or name and meaning one below the other.

    Args:
        rows: options.
        title: a line above.
        alike: options of all tables whose columns align with those of this one.
    """
    width = screen_width()
    if width < ROOM_FOR_COLUMNS:
        lines = [line for row in rows for line in _stacked(row, width)]
    else:
        name, kind = (
            min(max(len(row[column]) for row in [*rows, *alike]), most) if rows else 0
            for column, most in ((0, MOST_NAME), (1, MOST_TYPE))
        )
        lines = [line for row in rows for line in _in_columns(row, name, kind, width)]
    return "\n".join([*([heading(title)] if title else []), *lines])


def _stacked(row: Row, width: int) -> Iterator[str]:
    """The name, its type beside it if it fits there, and the meaning below."""
    name, kind, meaning = row
    first = f"{name}{GAP}{kind}".rstrip()
    fits = len(first) <= width
    yield first if fits else name
    for text in (meaning,) if fits else (kind, meaning):
        for line in _wrapped(text, width - len(INDENT)):
            yield f"{INDENT}{line}"


def _in_columns(row: Row, name_width: int, kind_width: int, width: int) -> Iterator[str]:
    """The name, its type and the meaning side by side."""
    name, kind, meaning = row
    names = [name]
    if len(name) > name_width:
        yield name
        names = []
    kinds = _wrapped(kind, kind_width)
    meanings = _wrapped(meaning, width - name_width - kind_width - 2 * len(GAP))
    for cells in zip_longest(names, kinds, meanings, fillvalue=""):
        line = f"{cells[0]:{name_width}}{GAP}{cells[1]:{kind_width}}{GAP}{cells[2]}"
        yield line.rstrip()


def _wrapped(text: str, width: int) -> list[str]:
    """The lines of a cell; a word that is wider than the cell, such as a path, stays whole."""
    return wrap(text, max(width, 1), break_long_words=False, break_on_hyphens=False)
