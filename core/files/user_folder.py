"""User folders: where the system wants what programs keep for a user."""

from __future__ import annotations

import os
import sys
from pathlib import Path

PROGRAM = "gsfw"


def cache_root() -> Path | None:
    """Folder for what can be made again; ``None`` for a user without a home."""
    return _folder("XDG_CACHE_HOME", "~/.cache")


def state_root() -> Path | None:
    """Folder for what is remembered between calls; ``None`` for a user without a home."""
    mac = "~/Library/Application Support"
    return _folder("XDG_STATE_HOME", mac if sys.platform == "darwin" else "~/.local/state")


def _folder(variable: str, default: str) -> Path | None:
    """By the XDG base directory specification, which ignores relative paths; by Windows' own."""
    chosen = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else variable, "")
    for root in (chosen, os.path.expanduser(default)):
        if os.path.isabs(root):
            return Path(root, PROGRAM)
    return None
