"""Which frames are held out."""

from pathlib import Path

import pytest
import torch

from gsfw.core.datamanager import DataRequest, Split
from gsfw.core.errors import DataError
from gsfw.datamanagers.frames import Frame, Lens
from gsfw.datamanagers.holdout import hold_out
from gsfw.datamanagers.images import Header

LENS = Lens(1.0, 1.0, 0.5, 0.5, 1, 1, "test")


def frames(*names: str, split: Split | None = None) -> list[Frame]:
    pose = torch.eye(4).double()
    return [Frame(name, Path(name), Header(1, 1, False), LENS, pose, split=split) for name in names]


def held(members: list[Frame], **settings) -> tuple[list[str], str]:
    splits, how = hold_out(members, DataRequest(None, **settings))
    chosen = [frame.name for frame, part in zip(members, splits, strict=True) if part is Split.EVAL]
    return chosen, how


NAMES = [f"{index:02d}.png" for index in range(10)]


def test_every_8th_from_the_first_is_held_out():
    assert held(frames(*NAMES)) == (["00.png", "08.png"], "every 8th by name")


def test_any_other_distance_may_be_asked_for():
    assert held(frames(*NAMES), eval_every_nth=3)[1] == "every 3rd by name"
    assert held(frames(*NAMES), eval_every_nth=12) == (["00.png"], "every 12th by name")
    assert held(frames(*NAMES), eval_every_nth=0) == ([], "as asked for")


def test_the_own_split_of_the_data_goes_before_every_nth():
    members = [*frames("a", "b", split=Split.TRAIN), *frames("c", split=Split.EVAL)]
    assert held(members) == (["c"], "the data set's own split")


def test_names_that_were_given_go_before_everything_else():
    members = [*frames("a", "b", split=Split.TRAIN), *frames("c", split=Split.EVAL)]
    assert held(members, eval_names=("a",)) == (["a"], "by name")


def test_a_file_name_is_enough_where_it_is_the_only_one():
    members = frames("left/0.png", "left/1.png", "right/1.png")
    assert held(members, eval_names=("0.png",))[0] == ["left/0.png"]
    with pytest.raises(DataError) as error:
        held(members, eval_names=("1.png",))
    assert str(error.value) == (
        "holdout=1.png: 2 images have this file name, left/1.png and right/1.png among them.\n"
        "Give the name with its folder."
    )


def test_a_name_that_does_not_exist_suggests_the_nearest():
    with pytest.raises(DataError) as error:
        held(frames("image_001.png", "image_002.png"), eval_names=("imag_002.png",))
    assert str(error.value) == (
        "holdout=imag_002.png: no image has this name. Did you mean 'image_002.png'?\n"
        "The 2 images are image_001.png to image_002.png."
    )


def test_a_format_may_say_how_its_split_came_about():
    _, how = hold_out(frames("a", split=Split.EVAL), DataRequest(None), "camera cam00")
    assert how == "camera cam00"
