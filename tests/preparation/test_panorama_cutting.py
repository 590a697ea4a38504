"""Cutting of panoramas: which images are cut, into what, and what is told of the others."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.cut_panoramas import cut, images, photos
from support.panorama import colored, view
from support.panorama_room import FULL_XMP, sphere

from gsfw.core.errors import ConfigError, DataError, OutputError
from gsfw.core.files.atomic import write_atomically
from gsfw.datamanagers.images import read_header
from gsfw.preparation import disk, panorama_cutting
from gsfw.preparation.panorama import Kind, Look
from gsfw.preparation.panorama_views import view_side


def write(path: Path, width: int = 512, height: int = 256, xmp: bytes = b"", shift: int = 0):
    pixels = np.roll(sphere(), shift, axis=1)
    Image.fromarray(pixels).resize((width, height), Image.Resampling.BOX).save(path, xmp=xmp)


def test_a_panorama_becomes_views_in_its_place(tmp_path):
    folder = photos(tmp_path)
    Image.fromarray(colored(view(0))).save(folder / "a.jpg")
    write(folder / "b.jpg", xmp=FULL_XMP)
    Image.fromarray(colored(view(200))).save(folder / "c.jpg")
    found, said = cut(images(folder), tmp_path)
    views = [f"b_{name}.jpg" for name in ("000", "060", "120", "180", "240", "300")]
    assert [one.name for one in found.images] == ["a.jpg", *views, "c.jpg"]
    side = view_side(512)
    for number, one in enumerate(found.images[1:7]):
        assert read_header(one.path) == one.header
        assert (one.header.width, one.header.height) == (side, side)
        assert one.view is not None
        assert (one.view.panorama, one.view.number, one.view.focal) == ("b.jpg", number, side / 2)
    assert said == [
        f"panoramas: 1 panorama is cut into 6 views of 90 degrees and {side}x{side} pixels; "
        "panoramas=false uses it uncut."
    ]


def test_a_sphere_has_views_up_and_down(tmp_path):
    folder = photos(tmp_path)
    write(folder / "b.jpg", xmp=FULL_XMP)
    found, _ = cut(images(folder), tmp_path, views="sphere")
    assert [one.name for one in found.images[6:]] == ["b_up.jpg", "b_down.jpg"]


def test_views_are_cut_once(tmp_path):
    folder = photos(tmp_path)
    write(folder / "b.jpg", xmp=FULL_XMP)
    first, _ = cut(images(folder), tmp_path)
    times = [one.path.stat().st_mtime_ns for one in first.images]
    first.images[2].path.unlink()
    again, _ = cut(images(folder), tmp_path)
    assert again == first
    kept = [one.path.stat().st_mtime_ns for one in again.images]
    assert [new == old for new, old in zip(kept, times, strict=True)] == [n != 2 for n in range(6)]
    write(folder / "b.jpg", xmp=FULL_XMP, shift=300)
    other, _ = cut(images(folder), tmp_path)
    assert other.images[0].path != first.images[0].path
    assert set((tmp_path / "views").iterdir()) == {one.path for one in other.images}


def test_an_interrupted_cutting_keeps_its_views(tmp_path, monkeypatch):
    folder = photos(tmp_path)
    write(folder / "b.jpg", xmp=FULL_XMP)
    finished = []

    def interrupted(file: Path, content: bytes) -> None:
        if len(finished) == 3:
            raise KeyboardInterrupt
        write_atomically(file, content)
        finished.append(file)

    monkeypatch.setattr(panorama_cutting, "write_atomically", interrupted)
    with pytest.raises(KeyboardInterrupt):
        cut(images(folder), tmp_path)
    assert sorted((tmp_path / "views").iterdir()) == sorted(finished)
    monkeypatch.undo()
    times = [file.stat().st_mtime_ns for file in finished]
    assert len(cut(images(folder), tmp_path)[0].images) == 6
    assert [file.stat().st_mtime_ns for file in finished] == times


def test_views_are_removed_with_their_panoramas(tmp_path):
    folder = photos(tmp_path)
    write(folder / "b.jpg", xmp=FULL_XMP)
    cut(images(folder), tmp_path, views="sphere")
    cut(images(folder), tmp_path)
    assert len(list((tmp_path / "views").iterdir())) == 6
    cut(images(folder), tmp_path, panoramas="false")
    assert not list((tmp_path / "views").iterdir())


def test_panoramas_of_one_size_are_cut_though_the_seam_of_one_is_seen(tmp_path):
    folder = photos(tmp_path)
    for number in range(3):
        write(folder / f"{number}.jpg", shift=100 * number)
    pixels = np.asarray(Image.open(folder / "0.jpg")).copy()
    pixels[:, :40] = 255
    Image.fromarray(pixels).save(folder / "0.jpg")
    found, _ = cut(images(folder), tmp_path)
    assert len(found.images) == 18


def test_a_panorama_that_lost_its_metadata_is_one_of_its_folder(tmp_path):
    folder = photos(tmp_path)
    for number in range(3):
        write(folder / f"{number}.jpg", xmp=FULL_XMP, shift=100 * number)
    pixels = np.asarray(Image.open(folder / "0.jpg")).copy()
    pixels[:, :40] = 255
    Image.fromarray(pixels).save(folder / "3.jpg")
    assert len(cut(images(folder), tmp_path)[0].images) == 24


def test_as_many_frames_as_intended_are_looked_at(tmp_path, monkeypatch):
    folder, looked = photos(tmp_path), []
    for number in range(17):
        write(folder / f"{number:02d}.jpg", 256, 128)

    def look(path, header):
        looked.append(path)
        return Look(Kind.VIEW)

    monkeypatch.setattr(panorama_cutting, "look_at", look)
    cut(images(folder, "walk"), tmp_path)
    assert len(looked) == panorama_cutting.LOOKED_AT


def test_frames_keep_their_video_and_time(tmp_path):
    folder = photos(tmp_path)
    for number in range(2):
        write(folder / f"{number}.jpg", shift=100 * number)
    found, _ = cut(images(folder, "walk"), tmp_path)
    assert {one.group for one in found.images} == {"walk"}
    assert [one.time for one in found.images] == [0.0] * 6 + [1.0] * 6
    assert len({one.shot for one in found.images}) == 2


def test_the_user_has_the_last_word(tmp_path):
    folder = photos(tmp_path)
    write(folder / "b.jpg", xmp=FULL_XMP)
    given = images(folder)
    assert cut(given, tmp_path, panoramas="false") == (given, [])
    Image.fromarray(colored(view(0)[:160, :320])).save(folder / "b.jpg")
    given = images(folder)
    assert cut(given, tmp_path) == (given, [])
    assert len(cut(given, tmp_path, panoramas="true")[0].images) == 6
    Image.fromarray(colored(view(0))).save(folder / "b.jpg")
    with pytest.raises(ConfigError, match="panoramas=true: no image is twice as wide as high"):
        cut(images(folder), tmp_path, panoramas="true")


def test_images_that_are_not_stitched_are_left_out_with_a_remedy(tmp_path):
    folder = photos(tmp_path)
    y, x = np.mgrid[:256, :512] + 0.5
    outside = np.hypot(x % 256 - 128, y - 128) > 128
    pixels = np.where(outside[..., None], 0, sphere())
    Image.fromarray(pixels.astype(np.uint8)).save(folder / "x.jpg")
    with pytest.raises(DataError, match=r"x\.jpg: there is no image.* two circles of fisheye"):
        cut(images(folder), tmp_path)
    write(folder / "y.jpg", 640, 320, FULL_XMP)
    found, _ = cut(images(folder), tmp_path)
    (item,) = found.left_out
    assert item.name == "x.jpg"
    assert "equirectangular" in item.advice


@pytest.mark.parametrize("choice", ["auto", "true"])
def test_parts_and_stereo_panoramas_are_left_out_with_their_own_remedies(tmp_path, choice):
    folder = photos(tmp_path)
    sizes = ("CroppedAreaImageWidthPixels", "FullPanoWidthPixels")
    sizes_down = ("CroppedAreaImageHeightPixels", "FullPanoHeightPixels")

    def described(width: int, height: int, full_width: int, full_height: int) -> bytes:
        numbers = dict(zip(sizes, (width, full_width), strict=True))
        numbers |= dict(zip(sizes_down, (height, full_height), strict=True))
        return (
            "equirectangular" + "".join(f' GPano:{k}="{v}"' for k, v in numbers.items())
        ).encode()

    write(folder / "a.jpg", 512, 128, described(512, 128, 1024, 512))
    write(folder / "b.jpg", 512, 256, described(512, 256, 1024, 512))
    write(folder / "c.jpg", 512, 512, described(512, 512, 512, 512))
    with pytest.raises(DataError, match=r"a\.jpg and 2 more: there is no image that can be used"):
        cut(images(folder), tmp_path, panoramas=choice)
    write(folder / "d.jpg", 640, 320, FULL_XMP)
    found, _ = cut(images(folder), tmp_path, panoramas=choice)
    assert len(found.images) == 6
    assert [item.name for item in found.left_out] == ["a.jpg", "b.jpg", "c.jpg"]
    assert "leave it out" in found.left_out[0].advice
    assert "one eye" in found.left_out[2].advice


def test_a_damaged_panorama_is_left_out(tmp_path):
    folder = photos(tmp_path)
    write(folder / "a.jpg", xmp=FULL_XMP)
    write(folder / "b.jpg", xmp=FULL_XMP, shift=200)
    content = (folder / "a.jpg").read_bytes()
    given = images(folder)
    (folder / "a.jpg").write_bytes(content[: len(content) // 2])
    found, said = cut(given, tmp_path)
    assert said[0].startswith("panoramas: 1 panorama is cut into 6 views")
    assert {one.shot for one in found.images} == {"/b.jpg"}
    assert [item.name for item in found.left_out] == ["a.jpg"]


def test_a_disk_without_room_is_told_before_cutting(tmp_path, monkeypatch):
    folder = photos(tmp_path)
    write(folder / "b.jpg", xmp=FULL_XMP)
    usage = disk.shutil.disk_usage(tmp_path)._replace(free=1_000_000)
    monkeypatch.setattr(disk.shutil, "disk_usage", lambda path: usage)
    with pytest.raises(OutputError, match="the disk is too full for views of panoramas"):
        cut(images(folder), tmp_path)


def test_views_with_alpha_need_the_room_of_png_files(tmp_path, monkeypatch):
    folder = photos(tmp_path)
    Image.fromarray(sphere()).save(folder / "a.jpg", xmp=FULL_XMP)
    usage = disk.shutil.disk_usage(tmp_path)._replace(free=disk.ROOM + 800_000)
    monkeypatch.setattr(disk.shutil, "disk_usage", lambda path: usage)
    assert len(cut(images(folder), tmp_path)[0].images) == 6
    (folder / "a.jpg").unlink()
    alpha = np.full((256, 512, 1), 128, np.uint8)
    Image.fromarray(np.concatenate([sphere(), alpha], axis=2)).save(folder / "a.png")
    with pytest.raises(OutputError, match="the disk is too full for views of panoramas"):
        cut(images(folder), tmp_path, panoramas="true")


def test_names_of_views_do_not_hide_photos(tmp_path):
    folder = photos(tmp_path)
    write(folder / "b.jpg", xmp=FULL_XMP)
    Image.fromarray(colored(view(0))).save(folder / "b_060.jpg")
    given = images(folder)
    found, _ = cut(given, tmp_path)
    assert [one.name for one in found.images] == [
        *("b_000.jpg", "b_060_2.jpg", "b_120.jpg", "b_180.jpg", "b_240.jpg", "b_300.jpg"),
        "b_060.jpg",
    ]


def test_frames_of_a_video_whose_metadata_tell_it_are_cut_whatever_they_show(tmp_path):
    folder = photos(tmp_path)
    for number in range(2):
        Image.new("RGB", (512, 256), (90, 120, 30 * number)).save(folder / f"{number}.jpg")
    given = images(folder, video="walk")
    assert cut(given, tmp_path)[0] == given
    told = replace(given, images=tuple(replace(one, said=Kind.PANORAMA) for one in given.images))
    assert len(cut(told, tmp_path)[0].images) == 12
    cubes = replace(given, images=tuple(replace(one, said=Kind.CUBE) for one in given.images))
    with pytest.raises(DataError, match="Its metadata call it a cube map"):
        cut(cubes, tmp_path)
    assert cut(cubes, tmp_path, panoramas="false")[0] == cubes
