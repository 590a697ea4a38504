"""Failure: how an error is told: one message, an exit code, and where the traceback went."""

from __future__ import annotations

import os
import sys
import tempfile
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from gsfw.commands.interface.console import Console
from gsfw.core.errors import UserError

if TYPE_CHECKING:
    from gsfw.core.loop.run_folder import RunFolder

UNEXPECTED = 1
INTERRUPTED = 130
"""Exit codes; the user's own mistakes have 2."""


class RecordedError(Exception):
    """An unexpected error whose traceback is already in a file."""

    def __init__(self, path: Path) -> None:
        super().__init__(str(path))
        self.path = path


@contextmanager
def tracebacks_in(folder: RunFolder) -> Iterator[None]:
    """Append the traceback of an unexpected error to a run's log, if the run stays.

    Raises:
        RecordedError: in place of that error.
    """
    try:
        yield
    except (UserError, BrokenPipeError):
        raise
    except Exception as error:
        if folder.latest_checkpoint() in (None, folder.checkpoint(0)):
            raise
        with folder.log.open("a", encoding="utf-8") as file:
            file.write("".join(traceback.format_exception(error)))
        raise RecordedError(folder.log) from error


def report(error: Exception, console: Console, debug: bool) -> int:
    """Tell the user about an error; the exit code."""
    if debug:
        traceback.print_exception(error, file=sys.stderr)
    if isinstance(error, UserError):
        _tell(console, error.message, error.advice)
        return error.exit_code
    if isinstance(error, RecordedError):
        path, cause = error.path, error.__cause__ or error
    else:
        path, cause = _record(error), error
    summary = f"{type(cause).__name__}: {cause}".splitlines()[0]
    _tell(
        console,
        f"gsfw failed unexpectedly: {summary}",
        f"The traceback is in {path}; --debug shows it here. This is a bug of gsfw or of a plugin.",
    )
    return UNEXPECTED


def _record(error: Exception) -> Path:
    handle, name = tempfile.mkstemp(prefix="gsfw-error-", suffix=".txt")
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write("".join(traceback.format_exception(error)))
    return Path(name)


def _tell(console: Console, message: str, advice: str) -> None:
    console.result({"error": message, "advice": advice})
    sys.stderr.write(f"error: {message}\n")
    if advice:
        sys.stderr.write(f"{advice}\n")
