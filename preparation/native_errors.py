"""Native errors: what COLMAP throws, said in words of ours."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gsfw.core.errors import DataError, UserError

ADVICE = (
    "Run the same command with a new out=DIR, so that features and matches are computed anew; if "
    "it fails again, report it with what is in DIR/work/log."
)
SOURCE_LINE = re.compile(r"^\[[\w.]+:\d+\]\s*")
"""Where in COLMAP's source an exception comes from, as its messages begin."""


@contextmanager
def readable_native_errors(task: str, database: Path) -> Iterator[None]:
    """Turn exceptions of pycolmap into one that users can act on.

    Args:
        task: what was tried, such as "compute camera poses".
        database: COLMAP's database that was worked on.

    Raises:
        DataError: pycolmap threw.
    """
    try:
        yield
    except UserError:
        raise
    except (RuntimeError, ValueError, IndexError, MemoryError) as error:
        raise native_failure(task, database, str(error)) from error


def native_failure(task: str, database: Path, said: str) -> DataError:
    """An error about a native call.

    Args:
        task: what was tried, such as "compute camera poses".
        database: COLMAP's database that was worked on.
        said: what COLMAP said; its last line is shown.
    """
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    reason = SOURCE_LINE.sub("", lines[-1]).rstrip(".") if lines else "it stopped without a word"
    return DataError(f"COLMAP could not {task} with {database}: {reason}.", ADVICE)
