"""The binary and the text reader of COLMAP models."""

import struct

import numpy as np
import pytest
from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, ring, write_colmap

from gsfw.core.errors import DataError
from gsfw.datamanagers.colmap import binary, text
from gsfw.datamanagers.colmap.model import ColmapCamera

READERS = {".bin": binary, ".txt": text}


@pytest.mark.parametrize("suffix", READERS)
def test_what_was_written_is_read(tmp_path, suffix):
    capture = ring(5)
    write_colmap(tmp_path, capture, suffix)
    reader = READERS[suffix]
    cameras = reader.read_cameras(tmp_path / f"cameras{suffix}")
    assert cameras == {1: ColmapCamera("PINHOLE", WIDTH, HEIGHT, (*FOCAL, *CENTER))}
    images = reader.read_images(tmp_path / f"images{suffix}")
    assert [image.name for image in images] == capture.names
    assert images[2].translation == tuple(capture.poses[2][:3, 3])
    points, colors = reader.read_points(tmp_path / f"points3D{suffix}")
    assert np.array_equal(points, capture.points)
    assert np.array_equal(colors, capture.colors)


@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
def test_a_binary_file_that_is_cut_off_anywhere_is_refused(tmp_path, part):
    write_colmap(tmp_path, ring(2))
    file = tmp_path / f"{part}.bin"
    content = file.read_bytes()
    read = getattr(binary, {"points3D": "read_points"}.get(part, f"read_{part}"))
    for length in range(len(content)):
        file.write_bytes(content[:length])
        with pytest.raises(DataError, match=rf"{part}\.bin is cut off or damaged: "):
            read(file)


def test_the_message_says_how_far_a_cut_off_file_goes(tmp_path):
    write_colmap(tmp_path, ring(3))
    file = tmp_path / "images.bin"
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(DataError) as error:
        binary.read_images(file)
    assert str(error.value) == (
        f"{file} is cut off or damaged: its 200 bytes end within image 2 of 3.\n"
        "Copy the model again, or write it anew with colmap model_converter."
    )


@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
def test_counts_are_never_trusted(tmp_path, part):
    write_colmap(tmp_path, ring(2))
    file = tmp_path / f"{part}.bin"
    file.write_bytes(struct.pack("<Q", 2**63) + file.read_bytes()[8:])
    read = getattr(binary, {"points3D": "read_points"}.get(part, f"read_{part}"))
    with pytest.raises(DataError, match=f"of {2**63}"):
        read(file)


def test_an_unknown_camera_model_is_named(tmp_path):
    file = tmp_path / "cameras.bin"
    file.write_bytes(struct.pack("<QiiQQ", 1, 7, 99, 4, 3))
    with pytest.raises(DataError, match="camera 7 has the unknown model number 99"):
        binary.read_cameras(file)


@pytest.mark.parametrize(
    ("read", "content", "message"),
    [
        (text.read_cameras, "1 PINHOLE 64", "line 1 should be CAMERA_ID MODEL WIDTH HEIGHT PARAMS"),
        (text.read_cameras, "1 PINHOLE 64 48 1 2", "line 1: camera model PINHOLE with 2 parameter"),
        (text.read_cameras, "1 MAGIC 64 48 1", "camera model MAGIC with 1 parameters .*knows"),
        (text.read_images, "#\n\n1 1 0 0 0 a.png", "line 3 should be IMAGE_ID QW QX QY QZ TX TY"),
        (text.read_images, "1 1 0 0 0 0 0 z 1 a.png", r"found '1 1 0 0 0 0 0 z 1 a\.png'"),
        (text.read_images, "1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 0 0 0 1 b.png", "line 2 .* left em"),
        (text.read_points, "1 0 0", "line 1 should be POINT3D_ID X Y Z R G B ERROR TRACK"),
    ],
)
def test_a_text_line_that_cannot_be_read_is_quoted(tmp_path, read, content, message):
    file = tmp_path / "model.txt"
    file.write_text(content)
    with pytest.raises(DataError, match=message):
        read(file)


def test_names_may_contain_spaces_and_the_last_line_may_be_missing(tmp_path):
    file = tmp_path / "images.txt"
    file.write_text("1 1 0 0 0 0 0 0 1 my photo.png")
    assert [image.name for image in text.read_images(file)] == ["my photo.png"]


def test_numbers_of_any_length_in_a_text_end_in_data_or_words(tmp_path):
    many = "9" * 40
    (tmp_path / "points3D.txt").write_text(f"1 0 0 0 {many} -{many} 3 0.5 1 2\n")
    points, colors = text.read_points(tmp_path / "points3D.txt")
    assert points.tolist() == [[0, 0, 0]]
    assert colors.tolist() == [[255, 0, 3]]
    (tmp_path / "points3D.txt").write_text(f"1 0 0 0 1 2 3 0.5 {many} 2\n")
    with pytest.raises(DataError, match="line 1 should be POINT3D_ID"):
        text.read_tracks(tmp_path / "points3D.txt")
    (tmp_path / "images.txt").write_text(f"{many} 1 0 0 0 0 0 0 1 a.png\n\n")
    with pytest.raises(DataError, match="line 1 should be IMAGE_ID"):
        text.read_images(tmp_path / "images.txt")
