"""Standard streams of a command that continues if nobody reads its output."""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

STREAMS = (("stdin", "r"), ("stdout", "w"), ("stderr", "w"))
"""The standard streams by their file numbers, with the mode of each."""
UNREAD = (errno.EPIPE, errno.EIO)
"""System errors of a pipe whose reader has gone, and of a terminal that has."""


class _Unread(io.FileIO):
    """A stream whose text is lost where it cannot be written, which is no error."""

    lost: tuple[int, ...] | None = None
    """System errors that lose the text; ``None`` for all of them."""

    def write(self, data: object) -> int | None:  # type: ignore[override]
        """Write bytes, or lose them."""
        try:
            return super().write(data)  # type: ignore[arg-type]
        except OSError as error:
            if self.lost is not None and error.errno not in self.lost:
                raise
            return memoryview(data).nbytes  # type: ignore[arg-type]


@contextmanager
def lasting_streams() -> Iterator[None]:
    """Let work continue without readers: results are in files, and messages in a run's log.

    A pipe or a terminal that is gone loses the text of both streams. A full disk loses that of
    standard error alone: standard output may be a JSON document that somebody relies on. A stream
    that was closed from the start becomes the null device: the next file would take its number,
    and receive what libraries print there. Characters that the encoding of a stream lacks, and
    bytes of names that are no text, are written as escapes.
    """
    for number, (name, mode) in enumerate(STREAMS):
        if getattr(sys, name) is None:
            handle = os.open(os.devnull, os.O_RDWR)  # The lowest free number, which is this one.
            setattr(sys, name, os.fdopen(handle, mode, closefd=handle != number))
    with _lasting("stdout", UNREAD), _lasting("stderr", None):
        yield


@contextmanager
def _lasting(name: str, lost: tuple[int, ...] | None) -> Iterator[None]:
    """Let a stream lose its text at some errors; unchanged where it is no plain file."""
    stream: TextIO = getattr(sys, name)
    buffer = getattr(stream, "buffer", None)  # With PYTHONUNBUFFERED it is the file itself.
    if type(getattr(buffer, "raw", buffer)) is not io.FileIO:
        yield  # A capture of a test, or a console of Windows.
        return
    stream.flush()
    raw = _Unread(stream.fileno(), "w", closefd=False)
    raw.lost = lost
    writer = io.BufferedWriter(raw)
    text = io.TextIOWrapper(writer, stream.encoding, "backslashreplace", line_buffering=True)
    setattr(sys, name, text)
    try:
        yield
    finally:
        setattr(sys, name, stream)
        raw.lost = None  # What could not be written so far has been reported.
        text.close()
