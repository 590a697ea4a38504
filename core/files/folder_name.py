"""Names of folders, as users write them."""

from __future__ import annotations

import os
from pathlib import Path


def names_folder(text: str) -> bool:
    """True if a path is that of a folder, or is written as one: with a slash at its end."""
    return text.endswith(("/", os.sep)) or (bool(text) and Path(text).is_dir())
