"""Capture times."""

from pathlib import Path

import pytest
import torch

from gsfw.core.errors import DataError
from gsfw.datamanagers.frames import Frame, Lens
from gsfw.datamanagers.images import Header
from gsfw.datamanagers.timeline import Timeline

LENS = Lens(1.0, 1.0, 0.5, 0.5, 1, 1, "test")


def frames(*times: float | None) -> list[Frame]:
    pose = torch.eye(4).double()
    return [
        Frame(f"{index}.png", Path(), Header(1, 1, False), LENS, pose, time=time)
        for index, time in enumerate(times)
    ]


def test_times_are_normalised_over_the_whole_data_set():
    timeline = Timeline.of(frames(10.0, 12.0, 12.0), unused_times=(20.0, 10.0))
    assert timeline == Timeline((10.0, 20.0), 3)
    assert [timeline.at(time) for time in (10.0, 12.0, 20.0)] == [0.0, 0.2, 1.0]


@pytest.mark.parametrize("times", [(None, None), (3.0, 3.0)])
def test_a_capture_of_no_or_of_one_time_is_static(times):
    timeline = Timeline.of(frames(*times))
    assert timeline == Timeline(None, 0)
    assert timeline.at(times[0]) is None


def test_times_for_some_frames_only_are_refused():
    with pytest.raises(DataError) as error:
        Timeline.of(frames(0.0, None, 1.0))
    assert str(error.value) == (
        "1.png has no time, but 2 of 3 frames have one.\nGive every frame its time, or none."
    )


def test_times_of_points_are_normalised_and_kept_within():
    timeline = Timeline.of(frames(10.0, 20.0))
    times = timeline.all_at(torch.tensor([10.0, 15.0, 30.0], dtype=torch.float64))
    assert times.tolist() == [0.0, 0.5, 1.0]
    assert timeline.all_at(None) is None
    assert Timeline.of(frames(3.0)).all_at(torch.zeros(2, dtype=torch.float64)) is None
