"""Markdown of the generated pages: tables, and docstrings of Google's style."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from inspect import cleandoc

SECTIONS = ("Args", "Returns", "Raises", "Yields", "Attributes")
"""Headings in docstrings, each with an indented list below it."""

_CODE = re.compile(r"(``?)(.+?)\1")


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; the cells are Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "".join(f"| {' | '.join(map(_cell, line))} |\n" for line in lines)


def _cell(text: str) -> str:
    return re.sub(r"[ \n]+", " ", text.replace("|", r"\|")).strip(" \n")


def code(text: str) -> str:
    """A literal; empty for no text."""
    return f"`{text}`" if text else ""


def prose(text: str) -> str:
    """Text of a docstring: literals stay, and no other character is markup."""
    parts, end = [], 0
    for literal in _CODE.finditer(text):
        parts += [_escaped(text[end : literal.start()]), f"`{literal[2]}`"]
        end = literal.end()
    return "".join([*parts, _escaped(text[end:])])


def _escaped(text: str) -> str:
    return re.sub(r"([*_<>\[\]])", r"\\\1", text)


def docstring(text: str) -> str:
    """A docstring as Markdown: paragraphs, blocks of code, and lists of arguments and errors."""
    blocks, section = [], ""
    for part in re.split(r"\n\s*\n", cleandoc(text)):
        heading, _, rest = part.partition(":\n")
        if heading in SECTIONS:
            section = heading
            blocks += [f"*{section}*", _items(_dedented(rest))]
        elif section and part.startswith("    "):
            blocks.append(_items(_dedented(part)))
        elif part.startswith("    "):
            blocks.append(f"```python\n{_dedented(part)}\n```")
        else:
            section = ""
            blocks.append(prose(part))
    return "\n\n".join(blocks)


def _dedented(text: str) -> str:
    return cleandoc(f"\n{text}")


def _items(text: str) -> str:
    """The items of a section: a name, a colon, and what it is, over one or several lines."""
    items: list[str] = []
    for line in text.splitlines():
        if line.startswith(" ") and items:
            items[-1] += f" {line.strip()}"
        else:
            items.append(line)
    return "\n".join(f"* {_item(item)}" for item in items)


def _item(text: str) -> str:
    name, colon, meaning = text.partition(": ")
    if colon and re.fullmatch(r"[\w.*, ]+", name):
        return f"{code(name)}: {prose(meaning)}"
    return prose(text)
