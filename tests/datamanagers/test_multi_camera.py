"""Which times are used, and which cameras held out."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.frames import Frame, Lens
from gsfw.datamanagers.images import Header
from gsfw.datamanagers.multi_camera import hold_out_cameras
from gsfw.datamanagers.synchronised_videos import SynchronisedVideosConfig

LENS = Lens(1.0, 1.0, 0.5, 0.5, 1, 1, "test")
FRAME = Frame("a", Path("a"), Header(1, 1, False), LENS, torch.eye(4, dtype=torch.float64))
FRAMES = [replace(FRAME, camera=camera, split=Split.EVAL) for camera in (0, 1, 2, 0)]
NAMES = ("left", "middle", "right")
TRAIN, EVAL = Split.TRAIN, Split.EVAL


def splits(asked, usual=()):
    frames, how = hold_out_cameras(FRAMES, NAMES, asked, usual)
    return [frame.split for frame in frames], how


def test_cameras_are_held_out_with_all_their_frames():
    assert splits(("left",)) == ([EVAL, TRAIN, TRAIN, EVAL], "camera left")
    assert splits(("right", "middle")) == ([TRAIN, EVAL, EVAL, TRAIN], "cameras middle, right")


def test_what_papers_hold_out_is_the_default():
    assert splits((), ("middle",)) == ([TRAIN, EVAL, TRAIN, TRAIN], "camera middle, as papers do")
    assert splits(("left",), ("middle",))[1] == "camera left"


def test_none_leaves_the_split_open():
    assert splits(("none",), ("left",)) == ([None] * 4, "")
    assert splits(()) == ([None] * 4, "")


def test_an_unknown_camera_is_refused():
    with pytest.raises(
        DataError,
        match=r"eval_cameras=midle: there is no camera of this name\. Did you mean 'middle'\?\n"
        r"The cameras are left, middle, right\.",
    ):
        splits(("midle",))


def test_holding_out_all_cameras_is_refused():
    with pytest.raises(DataError, match=r"eval_cameras=left,middle,right: no camera is left"):
        splits(NAMES)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, range(10)),
        ({"first": 4}, range(4, 10)),
        ({"frames": 3}, range(3)),
        ({"first": 1, "frames": 2, "stride": 3}, range(1, 7, 3)),
        ({"frames": 50}, range(10)),
    ],
)
def test_times_are_chosen(settings, expected):
    assert SynchronisedVideosConfig(**settings).chosen_times(10, "data") == expected
