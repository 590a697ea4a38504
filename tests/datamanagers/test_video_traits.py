"""Videos whose images are stored mirrored, interlaced, with oblong pixels, in two sizes."""

import struct
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from support.small_captures import HEIGHT, WIDTH
from support.small_videos import image, write_video

from gsfw.core.errors import DataError
from gsfw.datamanagers.video import Video
from gsfw.datamanagers.video_traits import VideoTraits

av = pytest.importorskip("av", reason="PyAV, which decodes videos, is not installed")

PLAIN = VideoTraits(WIDTH, HEIGHT)
PLACE_OF_MATRIX = 44
"""Bytes from the name of a track header to its matrix (ISO/IEC 14496-12, 8.3.2, version 0)."""


@pytest.mark.parametrize(
    ("matrix", "shown"),
    [
        ((-1, 0, 0, 1), lambda pixels: pixels[:, ::-1]),
        ((1, 0, 0, -1), lambda pixels: pixels[::-1]),
        ((0, 1, 1, 0), lambda pixels: pixels.swapaxes(0, 1)),
        ((0, -1, -1, 0), lambda pixels: pixels[::-1, ::-1].swapaxes(0, 1)),
        ((0, 1, -1, 0), lambda pixels: np.rot90(pixels, -1)),
    ],
)
def test_images_are_mirrored_and_turned_as_the_file_says(tmp_path, matrix, shown):
    plain = write_video(tmp_path / "a.mp4", count=2)
    video = turned(plain, matrix)
    expected = shown(Video.read(plain).image(1))
    assert np.array_equal(video.image(1), expected)
    assert (video.header.height, video.header.width) == expected.shape[:2]
    assert not video.traits.tilt


def test_a_tilt_that_is_no_quarter_turn_is_told(tmp_path):
    angle = np.radians(70)
    matrix = (np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle))
    traits = turned(write_video(tmp_path / "a.mp4", count=2), matrix).traits
    assert traits.turns % 2 == 1
    assert traits.tilt in (20, 21)
    (note,) = traits.notes()
    assert note.startswith("the video says that its images are tilted by 2")


def turned(plain, matrix) -> Video:
    """A video with another matrix in the header of its track."""
    content = bytearray(plain.read_bytes())
    a, b, c, d = (round(65536 * value) for value in matrix)
    place = content.index(b"tkhd") + PLACE_OF_MATRIX
    content[place : place + 36] = struct.pack(">9i", a, b, 0, c, d, 0, 0, 0, 1 << 30)
    path = plain.with_name("b.mp4")
    path.write_bytes(content)
    return Video.read(path)


def stored(path, **settings):
    """A video of one image, with settings of the encoder."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for name, value in settings.items():
            setattr(stream.codec_context, name, value)
        frame = av.VideoFrame.from_ndarray(image(0), format="rgb24").reformat(format="yuv420p")
        for name in {"color_trc"} & set(settings):
            if hasattr(frame, name):  # PyAV 14.1 lacks it.
                setattr(frame, name, settings[name])
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return Video.read(path).traits


def test_traits_are_read_from_the_file(tmp_path):
    assert replace(stored(tmp_path / "a.mp4"), transfer=0, primaries=0) == PLAIN
    assert stored(tmp_path / "b.mp4", sample_aspect_ratio=Fraction(4, 3)).aspect == Fraction(4, 3)
    assert stored(tmp_path / "c.mp4", color_trc=18).transfer == 18
    assert stored(tmp_path / "d.mp4", options={"x264-params": "interlaced=1"}).interlaced


def test_images_that_look_otherwise_than_they_should_are_told():
    assert not list(replace(PLAIN, transfer=16).notes())
    (note,) = replace(PLAIN, interlaced=True).notes()
    assert note.startswith("the video is interlaced: the rows of an image show two times, ")


def test_a_video_that_changes_its_size_is_refused_where_it_does(tmp_path):
    path = tmp_path / "a.webm"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libvpx", rate=30)
        other = av.CodecContext.create("libvpx", "w")
        for context, part in ((stream.codec_context, 1), (other, 2)):
            context.width, context.height = WIDTH // part, HEIGHT // part
            context.pix_fmt, context.time_base = "yuv420p", Fraction(1, 30)
            pixels = image(0, context.width, context.height)
            frame = av.VideoFrame.from_ndarray(pixels, format="rgb24").reformat(format="yuv420p")
            frame.pts, frame.time_base = part - 1, Fraction(1, 30)
            for packet in (*context.encode(frame), *context.encode(None)):
                packet.stream = stream
                container.mux(packet)
    video = Video.read(path)
    assert video.image(0).shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(DataError) as caught:
        video.image(1)
    assert caught.value.message == (
        f"{path}: image 1 has {WIDTH // 2}x{HEIGHT // 2} pixels, and the first one "
        f"{WIDTH}x{HEIGHT}."
    )
