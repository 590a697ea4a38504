"""Guided damage: changes of sound files, and of changed ones that led a reader to new lines.

Every few executions the lines of gsfw that a reader passes are noted. A file that leads to a line
that none before it led to joins the files that are changed further: so changes add up behind
checks that no single change passes.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from random import Random
from types import CodeType, FrameType
from typing import Any

from campaign import ROOT
from file_sets import Damage, FileSet, damage

TRACED = 4
"""Lines are noted in every fourth execution: that takes two to five times as long."""
FRESH = 0.4
"""Share of the changes that are made to a sound file, whatever else is there."""
MOST_FILES, LARGEST = 200, 1 << 16
"""Most changed files of a set that are kept, and the most bytes of each."""


class Coverage:
    """Lines of gsfw that were ever passed."""

    def __init__(self) -> None:
        self.lines: set[tuple[CodeType, int]] = set()
        self._own: dict[CodeType, bool] = {}

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Note the lines that this thread passes."""
        before = sys.gettrace()
        sys.settrace(self._enter)
        try:
            yield
        finally:
            sys.settrace(before)

    def _enter(self, frame: FrameType, event: str, argument: object) -> Callable[..., Any] | None:
        code = frame.f_code
        own = self._own.get(code)
        if own is None:
            name = code.co_filename
            own = self._own[code] = name.startswith(f"{ROOT}/") and "/campaigns/" not in name
        return self._line if own else None

    def _line(self, frame: FrameType, event: str, argument: object) -> Callable[..., Any]:
        self.lines.add((frame.f_code, frame.f_lineno))
        return self._line


class Corpus:
    """The files of a set that are changed: sound ones, and changed ones that were kept."""

    def __init__(self, files: FileSet) -> None:
        self.files = files
        self.kept: list[tuple[str, bytes]] = []

    def next(self, random: Random) -> Damage:
        """A changed file."""
        if self.kept and random.random() > FRESH:
            name, source = random.choice(self.kept)
        else:
            name = random.choice(self.files.damageable)
            source = self.files.files[name]
        return damage(self.files, name, source, random.getrandbits(63))

    def keep(self, change: Damage) -> None:
        """Take a changed file for further changes, in place of any other if there are too many."""
        if change.content is None or len(change.content) > LARGEST:
            return
        if len(self.kept) < MOST_FILES:
            self.kept.append((change.name, change.content))
        else:
            place = len(change.content) * 7919 % MOST_FILES
            self.kept[place] = (change.name, change.content)
