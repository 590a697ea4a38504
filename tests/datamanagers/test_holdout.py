"""Which frames are held out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from support.small_captures import ring

from gsfw.core.datamanager import DataRequest, Split
from gsfw.core.errors import DataError
from gsfw.core.hold_out import HoldOutBy
from gsfw.datamanagers.frames import Frame, Lens, Recording, Sightings
from gsfw.datamanagers.holdout import HeldOut, hold_out
from gsfw.datamanagers.images import Header

LENS = Lens(1.0, 1.0, 0.5, 0.5, 1, 1, "test")
POSE = torch.eye(4).double()


def frames(*names: str, split: Split | None = None) -> list[Frame]:
    return [Frame(name, Path(name), Header(1, 1, False), LENS, POSE, split=split) for name in names]


def recording(members: list[Frame], **more) -> Recording:
    nothing = torch.zeros(0, 3)
    return Recording("test", Path("test"), tuple(members), nothing.double(), nothing, **more)


def split_of(members: list[Frame], settings=None, **more) -> HeldOut:
    members = sorted(members, key=lambda frame: frame.name)
    return hold_out(members, DataRequest(None, **(settings or {})), recording(members, **more))


def names_of(found: HeldOut, members: list[Frame]) -> list[str]:
    members = sorted(members, key=lambda frame: frame.name)
    parts = zip(members, found.splits, strict=True)
    return [frame.name for frame, part in parts if part is Split.EVAL]


def held(members: list[Frame], **settings) -> tuple[list[str], str]:
    found = split_of(members, settings)
    return names_of(found, members), found.how


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
    found = split_of(frames("a", split=Split.EVAL), split_origin="camera cam00")
    assert found.how == "camera cam00"


def filmed(cameras: int, times: int) -> list[Frame]:
    """Cameras around the origin that stand still, each with an image at each time."""
    poses = ring(cameras).poses
    return [
        replace(
            frame,
            world_to_camera=torch.from_numpy(poses[camera]),
            camera=camera,
            time=time / 10,
        )
        for camera in range(cameras)
        for time in range(times)
        for frame in frames(f"cam{camera}/{time:03d}.png")
    ]


def left_at_each_time(found: HeldOut, members: list[Frame]) -> list[int]:
    """Number of training views at each time, in order of time."""
    members = sorted(members, key=lambda frame: frame.name)
    times = sorted({frame.time for frame in members if frame.time is not None})
    trained = [
        frame.time for frame, part in zip(members, found.splits, strict=True) if part is Split.TRAIN
    ]
    return [trained.count(time) for time in times]


@pytest.mark.parametrize(("cameras", "out"), [(4, 1), (9, 1), (16, 2), (20, 2)])
def test_of_several_cameras_that_film_whole_ones_are_held_out(cameras, out):
    members = filmed(cameras, 20)
    found = split_of(members)
    assert left_at_each_time(found, members) == [cameras - out] * 20
    assert found.how.startswith(f"{out} of {cameras} whole cameras, that of cam")
    assert len({name.split("/")[0] for name in names_of(found, members)}) == out


@pytest.mark.parametrize("cameras", [2, 3])
@pytest.mark.parametrize("every", [2, 3, 8])
def test_of_two_or_three_cameras_the_first_time_stays_whole_and_each_time_loses_one(cameras, every):
    members = filmed(cameras, 24)
    found = split_of(members, {"eval_every_nth": every})
    left = left_at_each_time(found, members)
    assert left[0] == cameras
    assert set(left) == {cameras - 1, cameras}
    assert found.how == (
        f"every {every}{'nd' if every == 2 else 'rd' if every == 3 else 'th'} by time, one of a "
        "time and none of the first, as whole cameras would leave "
        f"{cameras - 1} of {cameras}"
    )


def test_by_name_the_first_time_of_three_cameras_would_starve():
    members = filmed(3, 24)
    found = split_of(members, {"eval_by": HoldOutBy.NAME})
    assert left_at_each_time(found, members)[0] == 0
    assert found.how == "every 8th by name"


def test_who_wants_no_whole_camera_held_out_gets_single_images():
    members = filmed(9, 20)
    found = split_of(members, whole_cameras=False)
    assert len(names_of(found, members)) > 10
    assert left_at_each_time(found, members)[0] == 9
    assert min(left_at_each_time(found, members)) == 8


def test_a_single_camera_that_films_loses_every_8th():
    members = [replace(f, time=float(i)) for i, f in enumerate(frames(*NAMES))]
    assert held(members) == (["00.png", "08.png"], "every 8th by name")


def test_whole_cameras_need_several():
    with pytest.raises(DataError, match="all 10 images are those of one camera"):
        held(frames(*NAMES), eval_by=HoldOutBy.CAMERA)


def around(*degrees: float) -> list[Frame]:
    """Views of one place that look into directions of the horizon."""
    members = []
    for index, angle in enumerate(np.radians(degrees)):
        pose = POSE.clone()
        forward = [np.cos(angle), np.sin(angle), 0]
        pose[:3, :3] = torch.tensor([[np.sin(angle), -np.cos(angle), 0], [0, 0, -1], forward])
        members += [replace(frame, world_to_camera=pose) for frame in frames(f"{index:02d}.png")]
    return members


def test_the_only_view_of_a_region_goes_back_to_training_with_a_note():
    members = around(180, *range(-30, 35, 5))
    found = split_of(members)
    assert names_of(found, members) == ["08.png"]
    assert found.notes == (
        "00.png would be held out (every 8th by name), but no other image shows the same: trained "
        "on instead (holdout_by=name holds out all the same)",
    )
    assert found.how == "every 8th by name, but 1 that no other image is near"
    assert held(members, eval_by=HoldOutBy.NAME) == (["00.png", "08.png"], "every 8th by name")


def panoramas(count: int) -> list[Frame]:
    """Six views around from each of some places; rounded as in a file of text."""
    members = []
    for place in range(count):
        for view, frame in enumerate(around(*range(0, 360, 60))):
            rotation = frame.world_to_camera[:3, :3]
            pose = torch.eye(4).double()
            pose[:3, :3] = rotation
            pose[:3, 3] = -rotation @ torch.tensor([float(place), 0.5 * place**2, 1.0]).double()
            name = f"{place:02d}_{view}.png"
            members.append(replace(frame, name=name, world_to_camera=pose.round(decimals=6)))
    return members


def test_panoramas_are_held_out_whole():
    members = panoramas(9)
    out = [f"{place}_{view}.png" for place in ("00", "08") for view in range(6)]
    assert held(members) == (out, "every 8th of 9 places by name, with all views from there")
    by_name = held(members, eval_by=HoldOutBy.NAME)
    assert by_name == ([frame.name for frame in members[::8]], "every 8th by name")


def test_panoramas_are_held_out_whole_where_their_names_interleave():
    swapped = [replace(one, name=f"{one.name[3]}_{one.name[:2]}.png") for one in panoramas(9)]
    assert held(swapped)[0] == [
        f"{view}_{place}.png" for view in range(6) for place in ("00", "08")
    ]


def test_of_three_panoramas_single_views_are_held_out():
    assert held(panoramas(3))[1] == "every 8th by name"


def test_the_last_held_out_view_stays_one_with_a_note():
    members = around(0, 120, 240)
    found = split_of(members)
    assert (names_of(found, members), found.how) == (["00.png"], "every 8th by name")
    assert found.notes == (
        "00.png is held out, and no other image shows the same: its figures say little",
    )


def seen(shared: dict[int, list[int]]) -> Sightings:
    """Sightings by frame."""
    pairs = sorted((point, frame) for frame, points in shared.items() for point in points)
    points, rows = np.array(pairs).T
    return Sightings(points, rows, np.zeros(points.max() + 1))


def test_points_tell_better_than_directions_what_a_view_shows():
    members = around(*range(0, 80, 5))
    alone, common = list(range(100, 200)), list(range(100))
    shared = {row: common for row in range(16)} | {8: [*common[:20], *alone], 0: common}
    # What a held-out view shares with another held-out one is no help.
    found = split_of(members, sightings=lambda: seen(shared))
    assert names_of(found, members) == ["00.png"]
    everywhere = {row: common for row in range(16)}
    found = split_of(members, sightings=lambda: seen(everywhere))
    assert (names_of(found, members), found.notes) == (["00.png", "08.png"], ())


def test_two_views_that_show_the_same_alone_are_not_both_held_out():
    members = around(*[170, *range(-30, 5, 5), 175])
    found = split_of(members)
    assert names_of(found, members) in (["00.png"], ["08.png"])
    assert len(found.notes) == 1


def test_damaged_tracks_do_not_keep_from_training():
    def damaged() -> Sightings:
        raise DataError("points3D.bin is cut off.")

    members = around(*range(0, 80, 5))
    assert names_of(split_of(members, sightings=damaged), members) == ["00.png", "08.png"]


def test_sightings_are_those_of_frames_in_the_order_of_the_file():
    members = around(*range(0, 80, 5))
    backwards = tuple(reversed(members))
    shared = {row: list(range(100)) for row in range(15)} | {15: list(range(100, 200))}
    recorded = replace(recording(members), frames=backwards, sightings=lambda: seen(shared))
    found = hold_out(members, DataRequest(None), recorded)
    assert names_of(found, members) == ["08.png"], "the 15th from behind is the first"


def test_holding_out_over_space_takes_as_many_whatever_they_are_called():
    members = around(*range(0, 320, 10))
    found = split_of(members, {"eval_by": HoldOutBy.SPREAD})
    assert len(names_of(found, members)) == 4
    assert found.how == "one of 8, spread over space"
