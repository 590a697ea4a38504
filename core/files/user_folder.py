"""User folders: where the system wants what programs keep for a user."""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from pathlib import Path

from gsfw.core.errors import OutputError

PROGRAM = "gsfw"
ANOTHER = "Name a folder of your own for caches, such as XDG_CACHE_HOME=/data/me."
"""Remedy where there is no place that is safe."""


def cache_root() -> Path | None:
    """Folder for what can be made again; ``None`` for a user without a home."""
    return _folder("XDG_CACHE_HOME", "~/.cache")


def state_root() -> Path | None:
    """Folder for what is remembered between calls; ``None`` for a user without a home."""
    mac = "~/Library/Application Support"
    return _folder("XDG_STATE_HOME", mac if sys.platform == "darwin" else "~/.local/state")


def temporary_root() -> Path:
    """Folder of this user among the temporary files, for a user without a home.

    Everybody may make folders there, so that one of a known name may be another user's trap.

    Raises:
        OutputError: it is not this user's alone, or cannot be made.
    """
    user = os.getuid() if hasattr(os, "getuid") else None
    root = Path(tempfile.gettempdir(), f"{PROGRAM}-{'user' if user is None else user}")
    try:
        root.mkdir(mode=0o700, exist_ok=True)
        found = root.lstat()
    except OSError as error:
        raise OutputError(f"{root} cannot be made: {error}.", ANOTHER) from error
    is_own = user is None or (found.st_uid == user and not found.st_mode & 0o022)
    if not stat.S_ISDIR(found.st_mode) or not is_own:
        raise OutputError(f"{root} is not a folder that this user alone may write.", ANOTHER)
    return root


def _folder(variable: str, default: str) -> Path | None:
    """By the XDG base directory specification, which ignores relative paths; by Windows' own."""
    chosen = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else variable, "")
    for root in (chosen, os.path.expanduser(default)):
        if os.path.isabs(root):
            return Path(root, PROGRAM)
    return None
