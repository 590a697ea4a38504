"""Failure: reports an error as one message with an exit code; tracebacks go to a file."""

from __future__ import annotations

import errno
import os
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from gsfw.commands.interface.console import Console
from gsfw.core.errors import DataError, UserError
from gsfw.core.files.atomic import disk_error
from gsfw.parallel.environment import is_follower
from gsfw.plugins.registry import installed
from gsfw.plugins.specs import PROJECT

if TYPE_CHECKING:
    from gsfw.core.loop.run_folder import RunFolder
    from gsfw.plugins.discovery import PluginSource

UNEXPECTED = 1
INTERRUPTED = 130
"""Exit codes; errors of the user have 2."""
SHOWN = 80
"""Characters of a path that is too long for the system."""

OUT_OF_MEMORY = (
    "there is no memory left, on this machine or below the limit of this process.",
    "Shrink the images (downscale=2), keep fewer of them decoded (cache_mb=200), or limit the "
    "number of Gaussians (strategy=mcmc strategy.cap_max=200000). A scene that fits nowhere is "
    "trained in blocks: gsfw partition DATA out=DIR.",
)
"""Message and advice where the main memory is full."""


class RecordedError(Exception):
    """An unexpected error whose traceback is already in a file."""

    def __init__(self, path: Path) -> None:
        super().__init__(str(path))
        self.path = path


@contextmanager
def tracebacks_in(folder: RunFolder, stays: Callable[[], bool]) -> Iterator[None]:
    """Append the traceback of an unexpected error to the log of a run.

    Args:
        folder: folder of the run.
        stays: returns true if the folder is kept after an error.

    Raises:
        RecordedError: in place of that error.
        OutputError: in place of it if a disk is full or fails.
        DataError: in place of it if a file may not be used.
    """
    try:
        yield
    except (UserError, BrokenPipeError):
        raise
    except Exception as error:
        place = None if getattr(error, "filename", None) else folder.path
        if (clear := disk_error(error, place) or _forbidden(error)) is not None:
            raise clear from error
        if not stays():
            raise
        with folder.log.open("a", encoding="utf-8") as file:
            file.write("".join(traceback.format_exception(error)))
        raise RecordedError(folder.log) from error


def report(error: Exception, console: Console, debug: bool) -> int:
    """Print an error for the user; return the exit code.

    Of several processes of a training the first one reports what all of them find. What only
    another one finds, that one has printed already (``commands.interface.team``).
    """
    if is_follower() and isinstance(error, UserError):
        return error.exit_code
    if debug:
        traceback.print_exception(error, file=sys.stderr)
    error = (
        disk_error(error) or _too_long(error) or _forbidden(error) or _unencodable(error) or error
    )
    if isinstance(error, UserError):
        _tell(console, error.message, error.advice)
        return error.exit_code
    if is_out_of_memory(error):
        _tell(console, *OUT_OF_MEMORY)
        return UNEXPECTED
    if (full := _gpu_is_full(error)) is not None:
        _tell(console, *full)
        return UNEXPECTED
    path: Path | None
    if isinstance(error, RecordedError):
        path, cause = error.path, error.__cause__ or error
    else:
        path, cause = _record(error), error
    summary = f"{type(cause).__name__}: {cause}".splitlines()[0]
    culprit, bug = _culprit(cause)
    _tell(
        console,
        f"{culprit} failed unexpectedly: {summary}",
        f"{_place(path, debug)} {bug}",
    )
    return UNEXPECTED


def _place(path: Path | None, debug: bool) -> str:
    """A sentence on where the traceback is."""
    if path is None:
        return "The traceback is above." if debug else "debug=true shows the traceback."
    return f"The traceback is in {path}{'' if debug else '; debug=true shows it here'}."


def is_out_of_memory(error: BaseException) -> bool:
    """True if main memory could not be allocated.

    torch says so in a RuntimeError, and a refusal to map a file or start a process is an OSError.
    """
    found: BaseException | None = error
    while found is not None:
        refused = isinstance(found, RuntimeError) and "can't allocate memory" in str(found)
        refused |= isinstance(found, OSError) and found.errno == errno.ENOMEM
        if isinstance(found, MemoryError) or refused:
            return True
        found = found.__cause__ or found.__context__
    return False


def _too_long(error: BaseException) -> UserError | None:
    """The clear message for a path that is too long for the system; ``None`` for other errors."""
    if not isinstance(error, OSError) or error.errno != errno.ENAMETOOLONG:
        return None
    if error.filename is None:  # It does not name the path.
        return None
    path = os.fsdecode(error.filename)
    start = f"{path[:SHOWN]}..." if len(path) > SHOWN else path
    return DataError(
        f"{start}: the path ({len(path):,} characters), or a name in it, is too long for this "
        "system.",
        "Check the quotes of the command, or give a shorter path.",
    )


def _forbidden(error: BaseException) -> UserError | None:
    """The clear message for a file that this user may not use; ``None`` for other errors."""
    if not isinstance(error, PermissionError) or error.filename is None:
        return None
    return DataError(
        f"{os.fsdecode(error.filename)} cannot be used: {os.strerror(error.errno or 0)}.",
        "Change its permissions, or those of the folders above it (ls -ld shows them).",
    )


def _unencodable(error: BaseException) -> UserError | None:
    """The clear message for a file name that the locale has no letters for; else ``None``."""
    if not isinstance(error, UnicodeEncodeError):
        return None
    try:
        os.fsencode(error.object)
    except UnicodeEncodeError as own:
        if own.encoding != error.encoding or own.encoding == "utf-8":
            return None
    else:
        return None
    encoding = sys.getfilesystemencoding()
    return DataError(
        f"{error.object!a} cannot be the name of a file: this locale encodes names as {encoding}.",
        "Set PYTHONUTF8=1 for names in UTF-8, and give the same command again.",
    )


def _gpu_is_full(error: BaseException) -> tuple[str, str] | None:
    """Message and advice where a GPU's memory could not be allocated; ``None`` for other errors."""
    found: BaseException | None = error
    while found is not None:
        if type(found).__name__ == "OutOfMemoryError":  # Of torch, which may not be loaded.
            from gsfw.core.loop.full_memory import ADVICE, shortage

            return f"the GPU's memory is full{shortage(found)}.", ADVICE
        found = found.__cause__ or found.__context__
    return None


def _culprit(error: BaseException) -> tuple[str, str]:
    """The failed code, and a sentence on whose bug it is.

    The innermost frame of the traceback that runs code of a plugin names the package: gsfw checks
    its arguments, but cannot check the code of a plugin.
    """
    registry = installed()
    frames = list(traceback.walk_tb(error.__traceback__))
    for frame, line in reversed(frames):
        owner = registry.owner(frame.f_globals.get("__name__", ""))
        if owner is not None:
            code = frame.f_code
            place = getattr(code, "co_qualname", code.co_name)  # Python 3.10 has no qualified one.
            package = f"{owner.noun} {owner.version}".strip()
            return (
                f"{place} of {package} ({Path(code.co_filename).name}, line {line})",
                _missing_module(error, owner)
                or f"This is a bug of {owner.noun}, or it was made for another gsfw.",
            )
    plugins = ", ".join(registry.third_parties())
    return "gsfw", f"This is a bug of gsfw{f' or of a plugin: {plugins}' if plugins else ''}."


def _missing_module(error: BaseException, owner: PluginSource) -> str:
    """The remedy for a module of another package that a plugin imports; empty if there is none."""
    if not isinstance(error, ModuleNotFoundError) or not error.name:
        return ""
    module = error.name.partition(".")[0]
    if module in (PROJECT, owner.package):
        return ""
    return f"Install {module} (pip install {module}), which {owner.noun} needs."


def _record(error: Exception) -> Path | None:
    """Write the traceback of an error to a temporary file; ``None`` where the disk is full."""
    try:
        handle, name = tempfile.mkstemp(prefix="gsfw-error-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write("".join(traceback.format_exception(error)))
    except OSError:
        return None
    return Path(name)


def _tell(console: Console, message: str, advice: str) -> None:
    with suppress(OSError):  # Standard output may be what has failed.
        console.result({"error": message, "advice": advice})
    sys.stderr.write(f"error: {message}\n")
    if advice:
        sys.stderr.write(f"{advice}\n")
