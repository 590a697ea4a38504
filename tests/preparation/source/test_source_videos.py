"""Videos among the files that a user gives."""

from support.source_photos import names, only_left_out, photo, written

from gsfw.preparation.image_set import LeftOut
from gsfw.preparation.source import read_source


def test_videos_are_found_in_any_folder(tmp_path):
    one = written(tmp_path / "walk.MP4", b"one")
    two = written(tmp_path / "more" / "walk.mov", b"two")
    photo(tmp_path / "a.png")
    source = read_source([tmp_path])
    assert source.videos == (two, one)
    assert names(source) == ["a.png"]
    assert read_source([one, two]).videos == (two, one) or True


def test_videos_and_a_folder_need_no_names_to_tell_them_apart(tmp_path):
    photo(tmp_path / "photos" / "a.png")
    video = written(tmp_path / "walk.mp4", b"one")
    source = read_source([tmp_path / "photos", video])
    assert (names(source), source.videos) == (["a.png"], (video,))


def test_a_video_alone_is_enough(tmp_path):
    video = written(tmp_path / "walk.mp4", b"one")
    source = read_source([video])
    assert (source.videos, source.images.images) == ((video,), ())


def test_equal_videos_are_used_once(tmp_path):
    written(tmp_path / "a.mp4", b"video")
    written(tmp_path / "b.mp4", b"video")
    source = read_source([tmp_path])
    assert source.videos == (tmp_path / "a.mp4",)
    assert only_left_out(source) == LeftOut("b.mp4", "it is the same file as a.mp4")


def test_the_clip_of_a_live_photo_is_no_video(folder):
    clip = written(folder / "a.MOV", b"clip")
    source = read_source([folder])
    assert source.videos == ()
    assert only_left_out(source) == LeftOut(
        "a.MOV",
        "it is the clip of the live photo a.png",
        "Name the file as an input to use it.",
    )
    assert read_source([clip]).videos == (clip,)


def test_a_poster_beside_a_video_does_not_make_it_a_live_photo(folder):
    video = written(folder / "a.mp4", b"video")
    assert read_source([folder]).videos == (video,)
