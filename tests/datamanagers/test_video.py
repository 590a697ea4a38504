"""Video files."""

import struct
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.small_captures import HEIGHT, WIDTH, write_image
from support.small_videos import image, shade, write_video

from gsfw.core.errors import DataError, UnavailableError
from gsfw.datamanagers.video import Video, is_video

av = pytest.importorskip("av", reason="PyAV, which decodes videos, is not installed")

RATE, TICKS = 30, 512
"""Images per second of small videos, and the length of one in their own unit."""


def test_packets_tell_size_number_rate_times_and_key_frames(tmp_path):
    video = Video.read(write_video(tmp_path / "a.mp4", count=10, rate=25))
    assert (video.header.width, video.header.height) == (WIDTH, HEIGHT)
    assert len(video) == 10
    assert video.rate == pytest.approx(25)
    assert video.times == pytest.approx(np.arange(10) / 25)
    assert video.keys == (0, 4, 8)
    video.check_even()


def test_every_image_is_the_one_of_its_number(tmp_path):
    video = Video.read(write_video(tmp_path / "a.mp4"))
    for number, pixels in video.images(range(10)):
        assert np.abs(pixels.astype(int) - image(number)).mean() < 3
        assert abs(float(pixels[HEIGHT // 2 :].mean()) - (shade(number) - 7.5)) < 3


def test_images_are_the_same_bits_in_any_order(tmp_path):
    video = Video.read(write_video(tmp_path / "a.mp4"))
    in_order = dict(video.images(range(10)))
    assert list(in_order) == list(range(10))
    for number in (9, 3, 4, 0, 7, 5):
        assert np.array_equal(video.image(number), in_order[number])
    assert [number for number, _ in video.images(range(5, 8))] == [5, 6, 7]


def test_segments_go_from_key_frame_to_key_frame(tmp_path):
    video = Video.read(write_video(tmp_path / "a.mp4"))
    assert [video.segment(number) for number in (0, 3, 4, 9)] == [
        range(4),
        range(4),
        range(4, 8),
        range(8, 10),
    ]


@pytest.mark.parametrize("end", [".mov", ".mkv", ".avi"])
def test_other_containers_are_read(tmp_path, end):
    video = Video.read(write_video(tmp_path / f"a{end}", key_every=100))
    assert len(video) == 10
    video.check_even()
    assert np.abs(video.image(6).astype(int) - image(6)).mean() < 3


def test_an_mp4_called_mov_is_read_as_what_it_is(tmp_path):
    write_video(tmp_path / "a.mp4").rename(tmp_path / "a.mov")
    assert len(Video.read(tmp_path / "a.mov")) == 10


def rotated(path, degrees):
    """The video with a rotation in its metadata, as phones write it."""
    target = path.with_name("turned.mp4")
    with av.open(str(path)) as source, av.open(str(target), "w") as container:
        stream = container.add_stream_from_template(source.streams.video[0])
        if not hasattr(stream, "set_display_rotation"):
            pytest.skip("this PyAV writes no rotation")
        stream.set_display_rotation(degrees)
        for packet in source.demux(source.streams.video[0]):
            if packet.dts is not None:
                packet.stream = stream
                container.mux(packet)
    return target


@pytest.mark.parametrize("degrees", [90, -90, 180])
def test_rotation_metadata_is_applied(tmp_path, degrees):
    plain = write_video(tmp_path / "a.mp4")
    video = Video.read(rotated(plain, degrees))
    expected = np.rot90(Video.read(plain).image(2), video.traits.turns)
    assert (video.header.height, video.header.width) == expected.shape[:2]
    assert np.array_equal(video.image(2), expected)
    assert video.traits.turns == degrees // 90 % 4


def test_a_cropped_video_has_the_box_of_the_upright_image(tmp_path):
    video = Video.read(write_video(tmp_path / "a.mp4"))
    cropped = video.cropped((4, 6, 24, 36))
    assert (cropped.header.width, cropped.header.height) == (20, 30)
    assert np.array_equal(cropped.image(1), video.image(1)[6:36, 4:24])


def test_images_with_others_between_are_the_same(tmp_path):
    video = Video.read(write_video(tmp_path / "a.mp4"))
    all_of_them = dict(video.images(range(10)))
    chosen = dict(video.images([1, 5, 8]))
    assert list(chosen) == [1, 5, 8]
    assert all(np.array_equal(chosen[number], all_of_them[number]) for number in chosen)
    assert list(video.images([])) == []


def test_small_greys_are_the_images_shrunk(tmp_path):
    video = Video.read(write_video(tmp_path / "a.mp4"))
    assert [number for number, _ in video.greys(range(0, 10, 3), 32)] == [0, 3, 6, 9]
    for number, grey in video.greys(range(10), WIDTH // 2):
        assert grey.shape == (HEIGHT // 2, WIDTH // 2)
        colors = video.image(number).reshape(HEIGHT // 2, 2, WIDTH // 2, 2, 3)
        assert np.abs(grey - colors.mean((1, 3, 4))).mean() < 3
    assert next(video.greys([4], 1000))[1].shape == (HEIGHT, WIDTH)


@pytest.mark.parametrize("degrees", [90, 180])
def test_small_greys_are_upright_and_cropped(tmp_path, degrees):
    video = Video.read(rotated(write_video(tmp_path / "a.mp4"), degrees))
    box = (8, 4, 40, 36)
    ((_, whole),) = video.greys([2], max(WIDTH, HEIGHT))
    ((_, cropped),) = video.cropped(box).greys([2], 32)
    assert whole.shape == (video.header.height, video.header.width)
    assert np.array_equal(cropped, whole[4:36, 8:40])
    ((_, half),) = video.cropped(box).greys([2], 16)
    assert half.shape == (16, 16)
    assert np.abs(half - cropped.reshape(16, 2, 16, 2).mean((1, 3))).max() < 4


def test_a_varying_rate_is_refused_where_numbers_have_to_tell_the_time(tmp_path):
    stamps = [0, 1, 2, 3, 4, 5, 8, 9, 10, 11]
    video = Video.read(write_video(tmp_path / "a.mp4", stamps=stamps))
    assert video.times == pytest.approx(np.array(stamps) / 30)
    with pytest.raises(
        DataError,
        match=r"the frame rate varies: image 6 comes 100\.0 ms after the one before, where "
        r"33\.3 ms are usual\.\n.*ffmpeg -i a\.mp4 -vf fps=30 NEW\.mp4\.",
    ):
        video.check_even()


def test_an_empty_file_is_refused(tmp_path):
    (tmp_path / "a.mp4").touch()
    with pytest.raises(DataError, match=r"a\.mp4: the file is empty \(0 bytes\)\."):
        Video.read(tmp_path / "a.mp4")


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(DataError, match=r"a\.mp4: there is no such file\."):
        Video.read(tmp_path / "a.mp4")


def test_text_called_mp4_is_refused(tmp_path):
    (tmp_path / "a.mp4").write_text("hello world " * 20)
    with pytest.raises(DataError, match=r"a\.mp4: these 240 bytes are no video \(.*\)\."):
        Video.read(tmp_path / "a.mp4")


def test_an_image_called_mp4_is_refused(tmp_path):
    write_image(tmp_path / "a.png")
    (tmp_path / "a.png").rename(tmp_path / "a.mp4")
    with pytest.raises(DataError, match=r"a\.mp4: the file \(piped png sequence\) is no video\."):
        Video.read(tmp_path / "a.mp4")


def test_a_video_that_lost_its_end_is_refused(tmp_path):
    path = write_video(tmp_path / "a.mp4")
    content = path.read_bytes()
    path.write_bytes(content[: int(0.7 * len(content))])
    with pytest.raises(
        DataError, match=r"a\.mp4 is cut off: its header announces 10 images, \d are there\."
    ):
        Video.read(path)


def trim(path, first, count):
    """Let the edit list of a video show ``count`` images only, as editors and phones do."""
    content = bytearray(path.read_bytes())
    place = (
        content.index(b"elst") + 12
    )  # After the name, version and flags, and the number of edits.
    start = struct.unpack_from(">i", content, place + 4)[0]
    struct.pack_into(">Ii", content, place, round(1000 * count / RATE), start + first * TICKS)
    path.write_bytes(content)


@pytest.mark.parametrize(("first", "count"), [(2, 8), (0, 7), (5, 3)])
def test_a_trimmed_video_has_the_images_that_it_shows(tmp_path, first, count):
    path = write_video(tmp_path / "a.mp4")
    whole = list(Video.read(path).images(range(10)))
    trim(path, first, count)
    video = Video.read(path)
    assert len(video) <= 10 - first
    for number, pixels in video.images(range(count)):
        assert np.array_equal(pixels, whole[first + number][1])


def test_a_trimmed_video_that_lost_its_end_is_refused(tmp_path):
    path = write_video(tmp_path / "a.mp4")
    trim(path, 2, 8)
    content = path.read_bytes()
    path.write_bytes(content[: int(0.7 * len(content))])
    with pytest.raises(DataError, match=r"a\.mp4 is cut off: its header announces \d+ images"):
        Video.read(path)


def test_a_matroska_video_that_lost_its_end_is_refused(tmp_path):
    path = write_video(tmp_path / "a.mkv", 20, index_first=False)
    assert len(Video.read(path)) == 20
    content = path.read_bytes()
    path.write_bytes(content[: 2 * len(content) // 3])
    announced = (
        r"a\.mkv is cut off: its header announces 0\.67 s, and its last image is at 0\.\d+ s"
    )
    with pytest.raises(DataError, match=announced):
        Video.read(path)


def test_a_colon_in_a_relative_path_is_no_protocol(tmp_path, monkeypatch):
    write_video(tmp_path / "cam:1.mp4")
    monkeypatch.chdir(tmp_path)
    assert len(Video.read(Path("cam:1.mp4"))) == 10


def test_a_recording_that_was_never_finished_is_refused(tmp_path):
    path = write_video(tmp_path / "a.mp4", index_first=False)
    content = path.read_bytes()
    path.write_bytes(content[: content.index(b"moov") - 4])
    with pytest.raises(
        DataError, match=r"the video is cut off after \d+ bytes: its index \(the moov box\) is miss"
    ):
        Video.read(path)


def test_damaged_images_are_refused_when_they_are_reached(tmp_path):
    def noise(number, width, height):
        generator = np.random.default_rng(number)
        return generator.integers(0, 256, (height, width, 3)).astype(np.uint8)

    path = write_video(tmp_path / "a.mp4", draw=noise)
    content = bytearray(path.read_bytes())
    middle, length = len(content) * 6 // 10, len(content) // 4
    content[middle : middle + length] = b"\xff" * length
    path.write_bytes(content)
    video = Video.read(path)
    with pytest.raises(DataError, match=r"a\.mp4: .*(is damaged|does not decode)"):
        list(video.images(range(10)))


def test_without_pyav_it_is_said_how_to_get_it(tmp_path, monkeypatch):
    path = write_video(tmp_path / "a.mp4")
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(UnavailableError, match=r"Install it with: pip install 'gsfw\[video\]'"):
        Video.read(path)


def test_videos_are_told_by_their_names(tmp_path):
    for name in ("a.MP4", "b.png"):
        (tmp_path / name).touch()
    (tmp_path / "c.mp4").mkdir()
    found = {item.name: is_video(item) for item in tmp_path.iterdir()}
    assert found == {"a.MP4": True, "b.png": False, "c.mp4": False}


def test_a_folder_is_no_video(tmp_path):
    (tmp_path / "a.mp4").mkdir()
    with pytest.raises(DataError, match=r"a\.mp4: this is a folder\."):
        Video.read(tmp_path / "a.mp4")


def test_metadata_that_is_no_text_is_no_hindrance(tmp_path):
    path = write_video(tmp_path / "a.mp4")
    content = path.read_bytes()
    assert b"Lavf" in content
    path.write_bytes(content.replace(b"Lavf", b"\xff\xfe\xff\xfe"))
    assert len(Video.read(path)) == 10


def test_images_of_one_time_have_no_rate(tmp_path):
    video = Video.read(write_video(tmp_path / "a.mp4"))
    still = replace(video, stamps=(video.stamps[0],) * len(video))
    assert still.rate == 0
    with pytest.raises(DataError, match="most of its images have the time of another one"):
        still.check_even()
