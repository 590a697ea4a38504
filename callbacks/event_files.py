"""Event files of TensorBoard: cut back to the step from which a run goes on.

TensorBoard can purge steps that were repeated, but its readers differ in what they purge: one keeps
all, another keeps those that are not reached again. Without the events of after the checkpoint
there is nothing to purge.

A file is a sequence of TFRecords (tensorflow.org/tutorials/load_data/tfrecord): the length as
uint64 and its checksum, the content, and its checksum. They are copied as they are: the checksums
of tensorboard's own writer take a second for each megabyte.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from google.protobuf.message import DecodeError
from tensorboard.compat.proto.event_pb2 import Event

from gsfw.core.files.atomic import write_atomically

PATTERN = "events.out.tfevents.*"
LENGTH, CHECKSUM = struct.Struct("<Q"), 4
"""Length of a content, and bytes of a checksum."""
WRITING_THREAD = "_AsyncWriterThread"
"""Class of tensorboard's threads that write events."""


@contextmanager
def told_once() -> Iterator[None]:
    """Let threads that write events end without a traceback, as their writer tells their error."""
    before = threading.excepthook

    def tell(error: threading.ExceptHookArgs) -> None:
        if type(error.thread).__name__ != WRITING_THREAD:
            before(error)

    threading.excepthook = tell
    try:
        yield
    finally:
        threading.excepthook = before


def cut_events(folder: Path, is_kept: Callable[[int, str], bool]) -> None:
    """Leave out events, and files without any that are left.

    Args:
        folder: of the event files; it need not be there.
        is_kept: tells for a step and a tag whether it is kept.

    Raises:
        OutputError: a file cannot be written.
    """
    for path in sorted(item for item in folder.glob(PATTERN) if item.is_file()):
        content = path.read_bytes()
        kept, number = [], 0
        for record, event in _events(content):
            tags = [value.tag for value in event.summary.value]
            if event.WhichOneof("what") == "file_version":
                kept.append(record)
            elif tags and all(is_kept(event.step, tag) for tag in tags):
                kept.append(record)
                number += 1
        if not number:
            path.unlink()
        elif (left := b"".join(kept)) != content:
            write_atomically(path, left)


def _events(content: bytes) -> Iterator[tuple[bytes, Event]]:
    """The records of a file with their events, up to one that is cut short or damaged."""
    place, frame = 0, LENGTH.size + CHECKSUM
    while place + frame <= len(content):
        (length,) = LENGTH.unpack_from(content, place)
        end = place + frame + length + CHECKSUM
        if end > len(content):
            return
        try:
            event = Event.FromString(content[place + frame : end - CHECKSUM])
        except DecodeError:
            return
        yield content[place:end], event
        place = end
