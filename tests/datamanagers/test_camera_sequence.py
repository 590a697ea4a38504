"""What one camera has seen over time."""

import pytest
from support.small_captures import write_image
from support.small_videos import write_video

from gsfw.core.errors import DataError
from gsfw.datamanagers.camera_sequence import (
    CameraSequence,
    common_length,
    common_rate,
    find_sequences,
    images_in,
)


def test_images_are_ordered_by_the_numbers_in_their_names(tmp_path):
    for name in ("img_10.png", "img_9.png", "img_2.png"):
        write_image(tmp_path / name)
    (tmp_path / "notes.txt").touch()
    assert [path.name for path in images_in(tmp_path)] == ["img_2.png", "img_9.png", "img_10.png"]


def test_videos_go_before_folders(tmp_path):
    write_image(tmp_path / "cam1/0.png")
    assert find_sequences(tmp_path) == {"cam1": tmp_path / "cam1"}
    (tmp_path / "cam0.MP4").touch()
    assert find_sequences(tmp_path) == {"cam0": tmp_path / "cam0.MP4"}
    assert find_sequences(tmp_path, "take") == {}
    assert find_sequences(tmp_path / "nowhere") == {}


def test_a_folder_without_images_is_refused(tmp_path):
    with pytest.raises(DataError, match=r"the folder of camera a contains no images"):
        CameraSequence.read("a", tmp_path)


def test_names_tell_camera_and_number(tmp_path):
    write_image(tmp_path / "a/0007.png")
    sequence = CameraSequence.read("a", tmp_path / "a")
    assert (sequence.name(0), sequence.source(0)) == ("a/0007.png", (tmp_path / "a/0007.png", None))
    video = CameraSequence.read("b", write_video(tmp_path / "b.mp4", 3))
    assert (video.name(2), video.source(2)[1].number) == ("b/000002", 2)
    assert len(video) == 3


def test_the_rate_is_what_videos_or_the_user_say(tmp_path):
    videos = [
        CameraSequence.read(name, write_video(tmp_path / f"{name}.mp4", rate=25)) for name in "ab"
    ]
    assert common_rate(videos, 0.0) == (pytest.approx(25.0), "the videos'")
    assert common_rate(videos, 50.0) == (50.0, "datamanager.fps")
    assert common_rate((), 0.0)[0] == 30.0
    videos.append(CameraSequence.read("c", write_video(tmp_path / "c.mp4", rate=30)))
    with pytest.raises(
        DataError, match=r"c\.mp4 has 30 images per second, .*a\.mp4 25\.\n.*-vf fps=25 NEW\.mp4"
    ):
        common_rate(videos, 0.0)


def test_the_shortest_footage_decides_the_length(tmp_path):
    videos = [
        CameraSequence.read(name, write_video(tmp_path / f"{name}.mp4", count))
        for name, count in (("a", 5), ("b", 4))
    ]
    assert common_length(videos[:1]) == (5, ())
    assert common_length(videos)[0] == 4
