"""Names that the images and videos of a source have."""

import pytest
from support.source_photos import names, only_left_out, photo, photos, written

from gsfw.preparation.image_set import LeftOut
from gsfw.preparation.source import read_source


def test_images_are_sorted_by_the_numbers_in_their_names(tmp_path):
    source = read_source([photos(tmp_path, "img_10.png", "img_9.jpg", "img_2.webp")])
    assert names(source) == ["img_2.webp", "img_9.jpg", "img_10.png"]
    assert source.notes == ()
    assert source.videos == ()
    assert not source.images.in_order
    assert source.images.left_out == ()
    assert source.images.images[0].path == tmp_path / "img_2.webp"


@pytest.mark.parametrize("name", ["with space.png", "größe.png", "写真 1.png", "e\u0301.png"])
def test_names_stay_as_they_are(tmp_path, name):
    assert names(read_source([photos(tmp_path, name)])) == [name]


def test_bytes_in_a_name_that_are_no_text_are_replaced(tmp_path):
    path = tmp_path / b"caf\xe9.png".decode("utf-8", "surrogateescape")
    try:
        photo(path)
    except OSError:
        pytest.skip("this file system allows text only")
    source = read_source([tmp_path])
    assert names(source) == ["caf\ufffd.png"]
    assert source.images.images[0].path == path


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("two\nlines.png", "two_lines.png"),
        ("tab\t.png", "tab_.png"),
        ("y" * 251 + ".png", "y" * 196 + ".png"),
        ("\u00e9" * 125 + ".png", "\u00e9" * 98 + ".png"),
    ],
)
def test_names_that_no_list_or_disk_takes_are_changed(tmp_path, name, written):
    assert names(read_source([photos(tmp_path, name)])) == [written]


def test_copies_of_one_name_are_told_apart_by_their_folders(tmp_path):
    paths = [written(tmp_path / place / "v.mp4", b"a video") for place in ("a", "b")]
    assert only_left_out(read_source(paths)) == LeftOut(
        "v.mp4", f"it is the same file as {paths[0]}"
    )


def test_several_folders_are_told_apart_by_their_names(tmp_path):
    photos(tmp_path / "day 1", "a.png")
    photos(tmp_path / "day 2", "a.png", "sub/a.png")
    source = read_source([tmp_path / "day 2", tmp_path / "day 1"])
    assert names(source) == ["day 1/a.png", "day 2/a.png", "day 2/sub/a.png"]
    groups = [image.group for image in source.images.images]
    assert groups == ["day 1", "day 2", "day 2/sub"]


def test_folders_of_one_name_are_numbered(tmp_path):
    inputs = [photos(tmp_path / place / "Photos", "a.png") for place in "xy"]
    inputs.append(photos(tmp_path / "z" / "photos", "a.png"))
    assert names(read_source(inputs)) == ["Photos/a.png", "Photos_2/a.png", "photos_3/a.png"]


def test_image_folders_are_told_apart_by_their_data_sets(tmp_path):
    inputs = [photos(tmp_path / place / "images", "a.png") for place in ("fox", "owl")]
    assert names(read_source(inputs)) == ["fox/a.png", "owl/a.png"]


def test_names_that_some_disk_takes_for_one_are_told_apart(tmp_path):
    photos(tmp_path, "A.png", "a.jpg", "é.png", "e\u0301.png")
    photo(tmp_path / "a.bmp", content="PNG")
    if len(list(tmp_path.iterdir())) < 5:
        pytest.skip("this disk takes them for one itself")
    source = read_source([tmp_path])
    assert names(source) == ["A.png", "a.jpg", "a_2.png", "e\u0301.png", "é_2.png"]
    assert source.notes == (
        "named by content, not by extension: a.bmp -> a_2.png",
        "renamed, since some disks take two names for one: é.png -> é_2.png",
    )
