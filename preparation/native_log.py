"""Native log: what COLMAP writes of its work, in a file instead of on the terminal."""

from __future__ import annotations

from pathlib import Path

from gsfw.core.files.atomic import readable_write_errors

NEVER = 4
"""A level of severity that no line has."""


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
