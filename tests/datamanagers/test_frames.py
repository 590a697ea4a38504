"""Frames: images and the cameras that describe them."""

import os
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from gsfw.core.errors import DataError
from gsfw.datamanagers.frames import (
    Frame,
    data_path,
    missing_images,
    number_cameras,
)
from gsfw.datamanagers.images import Header
from gsfw.datamanagers.lens import Lens

LENS = Lens(70.0, 72.0, 31.0, 25.5, 64, 48, "camera 1 of cameras.bin")


def frame(width: int, height: int) -> Frame:
    header = Header(width, height, has_alpha=False)
    return Frame("a.jpg", Path("a.jpg"), header, LENS, torch.eye(4).double())


def test_the_camera_of_a_full_size_image_is_the_lens():
    camera = frame(64, 48).camera_at(1.0)
    torch.testing.assert_close(camera.intrinsics[0], LENS.matrix())
    assert (camera.width, camera.height) == (64, 48)


def test_an_image_smaller_by_a_whole_number_scales_the_camera():
    camera = frame(16, 12).camera_at(1.0)
    assert (camera.width, camera.height) == (16, 12)
    assert camera.intrinsics[0, 0].tolist() == [17.5, 0.0, 7.75]


def test_downscaling_rounds_the_size_and_keeps_the_exact_ratio_per_axis():
    camera = frame(64, 48).camera_at(5.0)
    assert (camera.width, camera.height) == (13, 10)
    assert camera.intrinsics[0, 0, 0] == pytest.approx(70 * 13 / 64)
    assert camera.intrinsics[0, 1, 2] == pytest.approx(25.5 * 10 / 48)


@pytest.mark.parametrize(("width", "height"), [(63, 48), (32, 16), (128, 96), (20, 16)])
def test_a_size_that_contradicts_the_camera_names_both(width, height):
    with pytest.raises(DataError) as error:
        frame(width, height).camera_at(1.0)
    assert str(error.value) == (
        f"a.jpg is {width}x{height} pixels, but camera 1 of cameras.bin describes 64x48.\n"
        "Use the images that the cameras were computed from. Smaller ones are fine where both "
        "sides are smaller by the same whole number; downscale=N shrinks images and cameras "
        "together."
    )


def test_an_image_that_was_turned_away_from_its_camera_is_explained():
    with pytest.raises(DataError) as error:
        frame(48, 64).camera_at(1.0)
    assert "a.jpg is 48x64 pixels, but camera 1 of cameras.bin" in str(error.value)
    assert "these are turned by 90 degrees, and their EXIF data does not say so" in str(error.value)


def test_a_locale_without_utf_8_is_named_beside_images_that_are_missing(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.getfilesystemencoding", lambda: "ascii")
    (note,) = missing_images(["é.png"], 2, tmp_path)
    assert note.endswith(
        "é.png (this locale encodes names as ascii; PYTHONUTF8=1 finds those in UTF-8)"
    )
    (note,) = missing_images(["e.png"], 2, tmp_path)
    assert note.endswith("left out: e.png")
    with pytest.raises(DataError, match=r"looked for é\.png.*PYTHONUTF8=1"):
        missing_images(["é.png"], 1, tmp_path)


def test_a_link_to_nowhere_is_not_a_file_with_another_name(tmp_path):
    (tmp_path / "a.jpg").symlink_to(tmp_path / "gone.jpg")
    (note,) = missing_images(["a.jpg"], 2, tmp_path)
    assert note.endswith("left out: a.jpg")


def test_a_file_whose_name_another_disk_takes_for_a_missing_one_is_named(tmp_path):
    accent = "e\N{COMBINING ACUTE ACCENT}.JPG"
    (tmp_path / accent).write_bytes(b"")
    (note,) = missing_images(["\xe9.jpg"], 2, tmp_path)
    assert f"left out: \xe9.jpg ({accent} is there, whose name differs in upper and lower " in note
    (note,) = missing_images(["other.jpg"], 2, tmp_path)
    assert note.endswith("other.jpg")


def test_a_folder_that_may_not_be_read_is_not_called_empty(tmp_path, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    with monkeypatch.context() as patch:
        patch.setattr(os, "listdir", refuse)
        with pytest.raises(DataError, match="Permission denied"):
            missing_images(["a.png"], 1, tmp_path)


def test_missing_images_are_listed_up_to_five(tmp_path):
    missing = [f"{index}.png" for index in range(7)]
    (note,) = missing_images(missing, 10, tmp_path)
    assert note == (
        "7 of 10 images are not on disk and are left out: "
        "0.png, 1.png, 2.png, 3.png, 4.png and 2 more"
    )
    assert missing_images([], 10, tmp_path) == ()


def test_a_data_set_without_any_image_is_refused():
    with pytest.raises(DataError) as error:
        missing_images(["a.png", "b.png"], 2, Path("data/images"))
    found = "none of the 2 images is in data/images (looked for a.png, b.png).\n"
    assert str(error.value) == f"{found}Put the images there."
    with pytest.raises(DataError) as error:
        missing_images(["a.png", "b.png"], 2, Path("data/images"), has_setting=True)
    advice = "Put the images there, or name their folder (datamanager.images=DIR)."
    assert str(error.value) == f"{found}{advice}"


def test_a_format_that_reads_files_wants_one():
    with pytest.raises(DataError, match="datamanager reads files, and data is empty"):
        data_path(None)
    with pytest.raises(DataError, match="data=nowhere: there is no such file or folder"):
        data_path(Path("nowhere"))


@pytest.mark.parametrize(("width", "height"), [(21, 16), (22, 16), (16, 12), (32, 24)])
def test_images_shrunk_by_a_whole_number_may_be_rounded_either_way(width, height):
    camera = frame(width, height).camera_at(1.0)
    assert (camera.width, camera.height) == (width, height)
    assert float(camera.intrinsics[0, 0, 2]) == pytest.approx(31.0 * width / 64)


def placed(distance: float, time: float | None, lens: Lens = LENS) -> Frame:
    pose = torch.eye(4).double()
    pose[2, 3] = distance
    return replace(frame(64, 48), world_to_camera=pose, time=time, lens=lens)


def cameras(*frames: Frame) -> list[int]:
    return [numbered.camera for numbered in number_cameras(frames)]


def test_frames_of_one_lens_are_of_one_camera_that_is_moved():
    other = replace(LENS, fx=80.0)
    assert cameras(placed(1, None), placed(2, None, other), placed(3, None)) == [0, 1, 0]
    # Monocular: at no two times is the camera at the same place.
    assert cameras(placed(1, 0.0), placed(2, 0.5), placed(3, 1.0)) == [0, 0, 0]


def test_cameras_that_stand_still_over_time_are_told_apart_by_where_they_are():
    frames = [placed(distance, time) for distance in (1, 2, 3) for time in (0.0, 0.5)]
    assert cameras(*frames, placed(4, 0.5)) == [0, 0, 1, 1, 2, 2, 3]


def test_an_image_that_is_there_twice_does_not_make_a_rig():
    assert cameras(placed(1, 0.5), placed(1, 0.5), placed(2, 1.0)) == [0, 0, 0]
