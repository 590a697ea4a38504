"""Sizes on the disk."""

from __future__ import annotations

from pathlib import Path


def bytes_of(path: Path) -> int:
    """Size of a file, or of all files below a folder; links in it count as themselves."""
    if not path.is_dir():
        return path.stat().st_size
    return sum(item.lstat().st_size for item in path.rglob("*") if not item.is_dir())
