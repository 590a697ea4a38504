"""Pages of the documentation: their blocks of code, and the commands in them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]

_RUN = re.compile(r"<!-- run -->\s*$")
"""The line before a block that a test runs; readers do not see it."""

_FENCE = re.compile(r"^( *)(```+)(\w*)[^\n]*\n(.*?)^\1\2$", re.MULTILINE | re.DOTALL)
_SPAN = re.compile(r"(?<!`)`(gsfw [^`\n]+)`(?!`)")


@dataclass(frozen=True)
class Block:
    """A block of code of a page."""

    page: Path
    line: int
    """Line of its fence, from 1."""
    language: str
    """Empty if none is given."""
    text: str
    runs: bool
    """True if a test runs it."""

    @property
    def place(self) -> str:
        """Page and line, for messages."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path) -> list[Block]:
    """All blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(
            page,
            text.count("\n", 0, fence.start()) + 1,
            fence[3],
            re.sub(f"^{fence[1]}", "", fence[4], flags=re.MULTILINE),
            _RUN.search(text, 0, fence.start()) is not None,
        )
        for fence in _FENCE.finditer(text)
    ]


@dataclass(frozen=True)
class Command:
    """A command line of a page."""

    place: str
    words: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.place}: {shlex.join(self.words)}"


def commands(text: str, place: str) -> list[Command]:
    """The commands of shell code, without comments, redirections and variables."""
    lines = text.replace("\\\n", " ").splitlines()
    return [Command(place, words) for line in lines for words in _commands(line)]


def _commands(line: str) -> Iterator[tuple[str, ...]]:
    """The commands of a line; "&&", ";" and "|" separate them."""
    lexer = shlex.shlex(re.sub(r"(^|\s)#.*", "", line), posix=True, punctuation_chars="&;|<>")
    lexer.commenters = ""
    lexer.whitespace_split = True
    words: list[str] = []
    redirected = False
    for word in [*lexer, ";"]:
        if set(word) <= set("&;|"):
            if words:
                yield tuple(words)
            words, redirected = [], False
        elif set(word) <= set("<>"):
            redirected = True
        elif not redirected and (words or not re.match(r"[A-Z_]+=", word)):
            words.append(word)


def spans(page: Path) -> list[Command]:
    """The commands of gsfw within the sentences of a page, if they are whole."""
    text = _FENCE.sub("", page.read_text(encoding="utf-8"))
    found = (match[1].replace("\\|", "|") for match in _SPAN.finditer(text))
    name = str(page.relative_to(ROOT))
    return [
        Command(name, tuple(shlex.split(line)))
        for line in found
        if "..." not in line and "|" not in line and "'" not in line
    ]
