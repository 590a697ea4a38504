"""What is used of the files that a user gives, and under which names."""

from pathlib import Path

import pytest
from PIL import Image
from PIL.ExifTags import Base
from support.photo_files import names, only_left_out, photo, photos, written

from gsfw.preparation.image_set import LeftOut
from gsfw.preparation.source import read_source


@pytest.fixture
def folder(tmp_path) -> Path:
    """Two good photos, so that something can be used."""
    return photos(tmp_path / "shots", "a.png", "b.png")


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


def test_what_another_preparation_has_only_begun_is_not_used(folder):
    photo(folder / "scene" / "work" / "frames" / "c.png")
    (folder / "scene" / "work" / "stages.json").touch()
    source = read_source([folder])
    assert names(source) == ["a.png", "b.png"]
    assert source.notes == (f"{folder / 'scene'} is not used: it is a result of gsfw prepare",)


def test_of_a_result_only_its_images_are_used(tmp_path):
    photos(tmp_path / "images", "a.png")
    photos(tmp_path, "prepare.png", "work/frames/b.png")
    (tmp_path / "prepare.json").touch()
    source = read_source([tmp_path])
    assert names(source) == ["a.png"]
    assert source.notes == (f"{tmp_path}: only images/ is used, as it is a result of gsfw prepare",)


def test_copies_of_one_name_are_told_apart_by_their_folders(tmp_path):
    paths = [written(tmp_path / place / "v.mp4", b"a video") for place in ("a", "b")]
    assert only_left_out(read_source(paths)) == LeftOut(
        "v.mp4", f"it is the same file as {paths[0]}"
    )


def test_sizes_are_those_of_the_upright_image(tmp_path):
    exif = Image.Exif()
    exif[Base.Orientation] = 6
    exif[Base.Model] = "Phone"
    photo(tmp_path / "a.jpg", exif=exif)
    (image,) = read_source([tmp_path]).images.images
    assert (image.header.width, image.header.height) == (6, 8)
    assert image.header.orientation == 6
    assert image.exif.model == "Phone"


def test_folders_in_a_folder_are_groups(tmp_path):
    photos(tmp_path, "cam10/a.png", "cam2/a.png", "cam2/deep/a.png", "a.png")
    source = read_source([tmp_path])
    assert names(source) == ["a.png", "cam2/a.png", "cam2/deep/a.png", "cam10/a.png"]
    groups = [image.group for image in source.images.images]
    assert groups == ["", "cam2", "cam2/deep", "cam10"]


def test_a_single_folder_in_a_folder_is_no_group(tmp_path):
    source = read_source([photos(tmp_path, "day/a.png", "day/b.png")])
    assert names(source) == ["day/a.png", "day/b.png"]
    assert {image.group for image in source.images.images} == {""}


@pytest.mark.parametrize("inner", ["images", "input"])
def test_the_image_folder_of_a_data_set_is_entered(tmp_path, inner):
    photos(tmp_path, f"{inner}/a.png")
    written(tmp_path / "sparse" / "0" / "cameras.bin", b"1234")
    source = read_source([tmp_path])
    assert names(source) == ["a.png"]
    assert source.notes == ()


def test_shrunk_copies_beside_the_images_of_a_data_set_are_not_read(tmp_path):
    photos(tmp_path, "images/a.png", "images_2/a.png", "masks/a.png")
    source = read_source([tmp_path])
    assert names(source) == ["a.png"]
    assert source.notes == (
        f"{tmp_path}: only images/ is used; name the folders beside it as inputs of their own if "
        "they hold other photos (images_2)",
    )


def test_results_beside_the_images_of_a_data_set_are_no_photos(tmp_path):
    photos(tmp_path, "images/a.png", "out/images/a.png", "old/images/a.png")
    written(tmp_path / "old" / "prepare.json", b"{}")
    source = read_source([tmp_path], out=tmp_path / "out")
    assert (names(source), source.notes) == (["a.png"], ())


def test_raw_input_comes_before_images_that_were_made_of_it(tmp_path):
    photos(tmp_path, "images/a.png", "input/b.png")
    assert names(read_source([tmp_path])) == ["b.png"]


def test_images_is_a_folder_like_others_where_images_lie_beside_it(tmp_path):
    photos(tmp_path, "a.png", "images/b.png")
    assert names(read_source([tmp_path])) == ["a.png", "images/b.png"]


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


def test_single_images_can_be_given(tmp_path):
    photos(tmp_path, "a.png", "b.png", "c.png")
    source = read_source([tmp_path / "c.png", tmp_path / "a.png"])
    assert names(source) == ["a.png", "c.png"]


def test_what_is_given_twice_is_used_once(tmp_path):
    photos(tmp_path, "a.png", "sub/b.png")
    for paths in (
        [tmp_path, tmp_path],
        [tmp_path, tmp_path / "a.png"],
        [tmp_path, tmp_path / "sub" / "b.png"],
    ):
        source = read_source(paths)
        assert names(source) == ["a.png", "sub/b.png"]
        assert source.images.left_out == ()
    assert len(read_source([tmp_path / "sub", tmp_path]).images.images) == 2


def test_a_link_back_does_not_lead_in_circles(folder):
    (folder / "again").symlink_to(folder, target_is_directory=True)
    assert names(read_source([folder])) == ["a.png", "b.png"]


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


def test_what_systems_leave_behind_is_not_looked_at(folder):
    for name in (".hidden.png", ".trash/x.png", "__MACOSX/x.png", "@eaDir/x.png"):
        photo(folder / name)
    written(folder / "Thumbs.db", b"1")
    photo(folder / "GX01.THM", content="JPEG")
    written(folder / ".DS_Store", b"1")
    source = read_source([folder])
    assert names(source) == ["a.png", "b.png"]
    assert source.images.left_out == ()
    assert source.notes == ()


def test_results_and_masks_in_a_folder_are_not_read(folder):
    photos(folder, "out/images/a.png", "old/images/a.png", "masks/a.png")
    written(folder / "old" / "prepare.json", b"{}")
    source = read_source([folder], out=folder / "out")
    assert names(source) == ["a.png", "b.png"]
    assert source.notes == (
        f"{folder / 'masks'} is not used: by its name, it holds masks",
        f"{folder / 'old'} is not used: it is a result of gsfw prepare",
    )


def test_an_image_is_named_by_its_content(folder):
    photo(folder / "c.jpg", content="PNG")
    photo(folder / "d.txt", content="JPEG")
    photo(folder / "e", content="WEBP")
    photo(folder / "f.HEIC", content="JPEG")
    photo(folder / "2024.05.01", content="TIFF")
    photo(folder / "g.JPG", content="JPEG")
    source = read_source([folder])
    assert names(source) == [
        *("2024.05.01.tif", "a.png", "b.png", "c.png", "d.jpg", "e.webp", "f.jpg", "g.JPG"),
    ]
    assert source.notes == (
        "named by content, not by extension: 2024.05.01 -> 2024.05.01.tif, c.jpg -> c.png, "
        "d.txt -> d.jpg, e -> e.webp, f.HEIC -> f.jpg",
    )


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


def test_of_several_pages_the_first_is_used(folder):
    pages = [Image.new("RGB", (8, 6), (shade, 0, 0)) for shade in (10, 20, 30)]
    pages[0].save(folder / "c.tif", save_all=True, append_images=pages[1:])
    pages[0].save(folder / "d.png", save_all=True, append_images=pages[1:2])
    source = read_source([folder])
    assert names(source) == ["a.png", "b.png", "c.tif", "d.png"]
    assert source.notes == (
        "the first image is used of files that hold several: c.tif (3), d.png (2)",
    )


def test_previews_behind_a_jpeg_are_no_pages(tmp_path):
    pages = [Image.new("RGB", (8, 6), (shade, 0, 0)) for shade in (10, 20)]
    pages[0].save(tmp_path / "a.jpg", "MPO", save_all=True, append_images=pages[1:])
    source = read_source([tmp_path])
    assert (names(source), source.notes) == (["a.jpg"], ())
