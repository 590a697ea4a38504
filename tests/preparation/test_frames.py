"""Frames of videos beside each other and beside photos."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from support.small_videos import write_video
from support.spherical_videos import CUBE, QUARTER, TOP_BOTTOM, WHOLE, state_in_entry, state_in_xmp

from gsfw.datamanagers.images import Header
from gsfw.datamanagers.video import Video
from gsfw.preparation.exif import Exif
from gsfw.preparation.frames import frames_of_videos
from gsfw.preparation.image_set import SourceImage
from gsfw.preparation.journal import Journal
from gsfw.preparation.panorama import Kind, kind_of_video
from gsfw.preparation.video_frames import choose_frames
from gsfw.preparation.workspace import Workspace


def photo(name: str) -> SourceImage:
    return SourceImage(name, Path(name), Header(64, 48, False, 1), Exif(), "")


@pytest.fixture
def taken(tmp_path):
    """A function that takes frames of videos of such names, and gives their names and groups."""
    noise = np.random.default_rng(0).integers(0, 255, (48, 96, 3), np.uint8)

    def take(*videos: str, photos: tuple[str, ...] = ()) -> tuple[set[str], set[str]]:
        paths = []
        for place, name in enumerate(videos):
            (tmp_path / str(place)).mkdir(exist_ok=True)
            path = tmp_path / str(place) / name
            write_video(path, 4, 64, 48, draw=lambda number, *_: noise[:, number : number + 64])
            paths.append(path)
        place = Workspace(tmp_path / "out")
        beside = [photo(name) for name in photos]
        journal = Journal(place.journal)
        frames = frames_of_videos(paths, 3, beside, place, journal, lambda text: None)
        return {frame.name.rpartition("/")[0] for frame in frames}, {
            frame.group for frame in frames
        }

    return take


def test_frames_of_the_only_video_have_no_folder(taken):
    assert taken("walk.mp4") == ({""}, {""})


def test_frames_beside_photos_have_names_and_a_camera_of_their_own(taken):
    assert taken("walk.mp4", photos=("000000.jpg",)) == ({"walk"}, {"walk"})
    assert taken("walk.mp4", photos=("Walk/000000.jpg",)) == ({"walk_2"}, {"walk_2"})


def test_videos_of_one_name_on_some_disk_have_folders_of_their_own(taken):
    assert taken("walk.mp4", "Walk.mp4")[0] == {"walk", "Walk_2"}


def test_a_name_that_is_no_folder_is_replaced(taken):
    assert taken("...mp4", "a\nb.mp4")[0] == {"video", "a_b"}


def test_frames_have_their_times_in_the_video(tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (48, 96, 3), np.uint8)
    video = write_video(
        tmp_path / "walk.mp4", 6, 64, 48, 10, draw=lambda number, *_: noise[:, number : number + 64]
    )
    place = Workspace(tmp_path / "out")
    frames = frames_of_videos([video], 6, [], place, Journal(place.journal), lambda text: None)
    assert len(frames) > 2
    for frame in frames:
        assert frame.time == pytest.approx(int(frame.path.stem) / 10)


def test_what_is_odd_about_a_video_is_told(tmp_path):
    video = Video.read(write_video(tmp_path / "a.mp4", 4))
    traits = replace(video.traits, interlaced=True, aspect=Fraction(4, 3))
    interlaced, oblong, *_ = choose_frames(replace(video, traits=traits), 3).notes
    assert interlaced.startswith("the video is interlaced: the rows of an image show two times, ")
    assert oblong.startswith("its pixels are not square (4/3 as wide as high), and cameras are ")


@pytest.mark.parametrize(
    ("boxes", "kind"),
    [
        (b"", None),
        (WHOLE, Kind.PANORAMA),
        (QUARTER, Kind.PART),
        (TOP_BOTTOM + WHOLE, Kind.STEREO),
        (CUBE, Kind.CUBE),
    ],
    ids=["nothing", "whole", "quarter", "stereo", "cube"],
)
def test_frames_have_the_kind_that_the_metadata_of_their_video_tell(tmp_path, boxes, kind):
    path = tmp_path / "walk.mp4"
    write_video(path, 4, 64, 32, index_first=False)
    state_in_entry(path, boxes)
    assert kind_of_video(Video.read(path).traits) is kind


def test_frames_of_a_video_with_xmp_data_are_panoramas(tmp_path):
    path = tmp_path / "walk.mp4"
    write_video(path, 4, 64, 32, index_first=False)
    state_in_xmp(path)
    place = Workspace(tmp_path / "out")
    frames = frames_of_videos([path], 3, [], place, Journal(place.journal), lambda text: None)
    assert {frame.said for frame in frames} == {Kind.PANORAMA}
