"""Printing: the lines of scripts, and the sizes of the pictures that they write."""

from __future__ import annotations

from pathlib import Path


def say(*lines: str) -> None:
    """Print lines at once."""
    print(*lines, sep="\n", flush=True)  # noqa: T201 - for scripts


def say_size(file: Path, most: int) -> None:
    """Print the size of a picture; stop the script if it has more than ``most`` bytes."""
    size = file.stat().st_size
    say(f"{file}: {size / 1e3:.0f} kB")
    if size > most:
        raise SystemExit(f"{file} is larger than {most / 1e3:.0f} kB")
