"""Room on the disk, looked at before COLMAP writes: on a full one it aborts the whole process."""

from __future__ import annotations

import shutil
from pathlib import Path

from gsfw.core.errors import OutputError

ROOM = 32_000_000
"""Bytes that the database may grow by from one look to the next, with the log of its changes."""


def check_room(path: Path) -> None:
    """Check that a database can grow.

    Args:
        path: of its file, in a folder that exists.

    Raises:
        OutputError: the disk is full, or nearly so.
    """
    free = shutil.disk_usage(path.parent).free
    if free < ROOM:
        raise OutputError(
            f"the disk is nearly full: {path} may need {ROOM // 1_000_000} MB more, and "
            f"{free // 1_000_000} MB are free.",
            "Free some space, and the same command goes on; or choose another place with out=DIR.",
        )
