"""Progress: how far something is that writes one file after the other."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path


def with_progress(files: Iterator[Path], total: int, name: str) -> list[Path]:
    """Write all, with a bar on a terminal; the files."""
    from rich.console import Console as Screen
    from rich.progress import track

    screen = Screen(stderr=True)
    if not screen.is_terminal:
        return list(files)
    return list(track(files, description=name, total=total, console=screen))
