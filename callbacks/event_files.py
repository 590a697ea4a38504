"""Event files of TensorBoard: cut back to the step from which a run goes on.

TensorBoard can purge steps that were repeated, but its readers differ in what they purge: one keeps
all, another keeps those that are not reached again. Without the events of after the checkpoint
there is nothing to purge.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

from tensorboard.backend.event_processing.event_file_loader import RawEventFileLoader
from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.summary.writer.record_writer import RecordWriter

from gsfw.core.files.atomic import write_atomically

PATTERN = "events.out.tfevents.*"


def cut_events(folder: Path, is_kept: Callable[[int, str], bool]) -> None:
    """Leave out events, and files without any that are left.

    Args:
        folder: of the event files; it need not be there.
        is_kept: tells for a step and a tag whether it is kept.

    Raises:
        OutputError: a file cannot be written.
    """
    for path in sorted(folder.glob(PATTERN)):
        kept, number, dropped = io.BytesIO(), 0, 0
        writer = RecordWriter(kept)
        # A record that a crash has cut short ends the file.
        for record in RawEventFileLoader(str(path)).Load():
            event = Event.FromString(record)
            tags = [value.tag for value in event.summary.value]
            if event.WhichOneof("what") == "file_version":
                writer.write(record)
            elif tags and all(is_kept(event.step, tag) for tag in tags):
                writer.write(record)
                number += 1
            else:
                dropped += 1
        if not number:
            path.unlink()
        elif dropped:
            write_atomically(path, kept.getvalue())
