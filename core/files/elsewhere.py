"""Elsewhere: a file that cannot be written to its place goes to the temporary folder."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from gsfw.core.errors import OutputError


def write_here_or_elsewhere(path: Path, write: Callable[[Path], object]) -> tuple[str, str]:
    """Write a file to its place or else to a new temporary folder.

    For by-products, without which the rest of the work is worth as much.

    Args:
        path: the place.
        write: writes the file to a place; raises ``OutputError`` if it cannot.

    Returns:
        The place of the file, empty if it could be written to neither; and a sentence on why it is
        not at ``path``, empty if it is.
    """
    try:
        write(path)
    except OutputError as error:
        problem = error.message
    else:
        return str(path), ""
    try:
        other = Path(tempfile.mkdtemp(prefix="gsfw-"), path.name)
        write(other)
    except (OSError, OutputError):
        return "", f"{problem} out=FILE gives it another place; out=none leaves it out."
    return str(other), f"{problem} It is {other} instead; out=FILE gives it another place."
