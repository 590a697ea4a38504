"""Event files of TensorBoard are cut back."""

import struct

import pytest
from tensorboard.compat.proto.event_pb2 import Event

from gsfw.callbacks.event_files import cut_events

NAME = "events.out.tfevents.1.host.1.0"


def record(step: int) -> bytes:
    event = Event(step=step, wall_time=1.0)
    event.summary.value.add(tag="loss", simple_value=0.5)
    content = event.SerializeToString()
    return struct.pack("<Q4x", len(content)) + content + bytes(4)


def before_three(step: int, tag: str) -> bool:
    return step < 3


def test_events_from_a_step_on_are_left_out(tmp_path):
    (tmp_path / NAME).write_bytes(b"".join(map(record, range(5))))
    cut_events(tmp_path, before_three)
    assert (tmp_path / NAME).read_bytes() == b"".join(map(record, range(3)))


@pytest.mark.parametrize("damage", [b"", b"\xff" * 40, struct.pack("<Q", 1 << 63) + bytes(40)])
def test_events_end_at_a_damaged_one(tmp_path, damage):
    (tmp_path / NAME).write_bytes(record(1) + damage + record(2))
    cut_events(tmp_path, before_three)
    assert (tmp_path / NAME).read_bytes().startswith(record(1))


def test_what_is_no_file_is_left_alone(tmp_path):
    (tmp_path / NAME).mkdir()
    (tmp_path / f"{NAME}1").symlink_to(f"{NAME}1")
    cut_events(tmp_path, before_three)
    assert (tmp_path / NAME).is_dir()
