"""Native signals: what ends a program stays Python's to handle, although COLMAP would take it."""

from __future__ import annotations

import re
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from traceback import clear_frames
from types import FrameType
from typing import TYPE_CHECKING

from gsfw.core.errors import DataError, UserError
from gsfw.core.files.atomic import readable_write_errors
from gsfw.kernels.cpu.native_module import last_words

if TYPE_CHECKING:
    from pycolmap import Database

ADVICE = (
    "Run the same command with a new out=DIR, so that features and matches are computed anew; if "
    "it fails again, report it with what is in DIR/work/log."
)
ABORTED = (
    "The disk may be full or failing. Free some space, and run the same command, which continues; "
    "if it fails again, report it with what is in DIR/work/log."
)
SOURCE_LINE = re.compile(r"^\[[\w.]+:\d+\]\s*")
"""Source line of COLMAP at the beginning of its messages."""
NEVER = 4
"""A level of severity that no line has."""


def load_colmap() -> None:
    """Import pycolmap, and leave the signals that end a program as they were.

    By itself the import makes SIGTERM print a stack trace and end the program at once, without
    the cleaning up that Python's handlers allow; and it fails when Ctrl-C comes in its midst.

    Raises:
        ImportError, RuntimeError: it is not installed, or does not fit the machine.
        KeyboardInterrupt: after the import, if Ctrl-C came.
    """
    if threading.current_thread() is not threading.main_thread():
        import pycolmap  # Others cannot set handlers.

        return
    came: list[int] = []

    def remember(number: int, frame: FrameType | None) -> None:
        came.append(number)

    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    if before[signal.SIGINT] is signal.default_int_handler:
        signal.signal(signal.SIGINT, remember)
    try:
        import pycolmap  # noqa: F401 - to be loaded is all
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        raise KeyboardInterrupt


@contextmanager
def readable_native_errors(task: str, database: Path) -> Iterator[None]:
    """Turn exceptions of pycolmap into one that users can act on.

    What its own threads throw would abort the process: it ends with a message, too.

    Args:
        task: what was tried, such as "compute camera poses".
        database: COLMAP's database that was worked on.

    Raises:
        DataError: pycolmap threw.
    """
    words = (f"error: COLMAP could not {task} with {database}", f"{ABORTED}\n", DataError.exit_code)
    try:
        with last_words(*words):
            yield
    except UserError:
        raise
    except (RuntimeError, ValueError, IndexError, MemoryError) as error:
        raise native_failure(task, database, str(error)) from error


@contextmanager
def opened_database(path: Path, task: str) -> Iterator[Database]:
    """An opened database of COLMAP, whose errors name the task ("read the images").

    Raises:
        DataError: COLMAP cannot work with the database.
    """
    import pycolmap

    with readable_native_errors(task, path), pycolmap.Database.open(path) as database:
        yield database


def names_by_number(database: Database) -> dict[int, str]:
    """The names of all images of a database by their numbers."""
    return {image.image_id: image.name for image in database.read_all_images()}


@contextmanager
def aborts_told(folder: Path) -> Iterator[None]:
    """End with a message if COLMAP aborts the process, as when it closes a database after an error.

    Args:
        folder: of the preparation.
    """
    with last_words(
        f"error: COLMAP stopped its work in {folder}", f"{ABORTED}\n", DataError.exit_code
    ):
        try:
            yield
        except UserError as error:
            # Databases that an error holds by its traceback are closed here, and not at the end.
            held: BaseException | None = error
            while held is not None:
                clear_frames(held.__traceback__)
                held = held.__cause__ or held.__context__
            raise


def native_failure(task: str, database: Path, said: str) -> DataError:
    """An error about a native call.

    Args:
        task: what was tried, such as "compute camera poses".
        database: COLMAP's database that was worked on.
        said: what COLMAP said; its last line is shown.
    """
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    reason = SOURCE_LINE.sub("", lines[-1]).rstrip(".") if lines else "it stopped without a message"
    return DataError(f"COLMAP could not {task} with {database}: {reason}.", ADVICE)


def log_into(folder: Path) -> None:
    """Let COLMAP write into files of a folder from now on, named by date and process.

    Raises:
        OutputError: the folder cannot be made.
    """
    from pycolmap import logging

    with readable_write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    logging.alsologtostderr = False
    logging.logtostderr = False
    logging.stderrthreshold = NEVER
    # A file of one level takes those of the graver ones, too.
    logging.set_log_destination(logging.INFO, str(folder / "colmap-"))
    for level in (logging.WARNING, logging.ERROR, logging.FATAL):
        logging.set_log_destination(level, "")
