"""What is used of the files that a user gives, and why other files are not."""

import itertools
import shutil
from pathlib import Path

import pytest
from PIL import Image
from PIL.ExifTags import Base

from gsfw.core.errors import DataError
from gsfw.preparation.image_set import LeftOut
from gsfw.preparation.source import Source, read_source

SERIAL = itertools.count()


def photo(path: Path, size: tuple[int, int] = (8, 6), content: str = "", **settings) -> Path:
    """An image unlike any other."""
    path.parent.mkdir(parents=True, exist_ok=True)
    number = next(SERIAL)
    shade = (37 * number % 256, 91 * number % 256, 11 * number % 256)
    Image.new("RGB", size, shade).save(path, content or None, **settings)
    return path


def photos(folder: Path, *names: str) -> Path:
    for name in names:
        photo(folder / name)
    return folder


def written(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def names(source: Source) -> list[str]:
    return [image.name for image in source.images.images]


def only_left_out(source: Source) -> LeftOut:
    (item,) = source.images.left_out
    return item


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


def test_much_smaller_images_are_used_and_told_of(tmp_path):
    for name in "abc":
        photo(tmp_path / f"{name}.png", (64, 48))
    photo(tmp_path / "d.png", (16, 12))
    photo(tmp_path / "e.png", (12, 15))
    source = read_source([tmp_path])
    assert len(names(source)) == 5
    assert source.notes == (
        "much smaller than the usual 64 pixels, perhaps thumbnails, which are better removed: "
        "e.png (12x15)",
    )


def test_other_files_are_counted_only(folder):
    for name in ("list.csv", "a.xmp", "b.xmp", "empty.txt", "LICENSE"):
        written(folder / name, b"" if name == "empty.txt" else b"text")
    source = read_source([folder])
    assert source.images.left_out == ()
    assert source.notes == (
        "files that hold no image are not used: 5 (.csv, .txt, .xmp, no extension)",
    )


def test_damaged_exif_does_not_matter(tmp_path):
    photo(tmp_path / "a.jpg", exif=b"Exif\0\0II*\0\xff\xff\xff\xff")
    assert names(read_source([tmp_path])) == ["a.jpg"]


HEIC_ADVICE = (
    "Convert them to JPEG. macOS: sips -s format jpeg *.HEIC --out FOLDER. Linux: heif-convert -q "
    "95 IN.HEIC OUT.jpg for each (in Debian's libheif-examples). Windows: open and save them in "
    "Photos. An iPhone takes JPEG with Settings > Camera > Formats > Most Compatible."
)
RAW_ADVICE = (
    "Develop all of them with the same settings, and uncropped, to JPEG, PNG or TIFF: with the "
    "camera's own program, or darktable-cli IN OUT.jpg for each."
)
JPEG = b"\xff\xd8\xff\xe0\0\x10JFIF\0\x01\x01\0\0\x01\0\x01\0\0"
PNG = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0"
CUT_OFF = "the image is cut off or damaged: its header is not whole"


@pytest.mark.parametrize(
    ("name", "content", "reason", "advice"),
    [
        ("x.jpg", b"", "the file is empty (0 bytes)", "Copy it again from the camera."),
        ("x.mp4", b"", "the file is empty (0 bytes)", "Copy it again from the camera."),
        (
            "x.jpg",
            b"not an image",
            "it is no PNG, JPEG, WEBP, TIFF or BMP image, by its content",
            "Replace or remove it.",
        ),
        ("x.jpg", JPEG, CUT_OFF, "Copy it again."),
        ("x.png", PNG, CUT_OFF, "Copy it again."),
        ("x.HEIC", b"\0\0\0\x18ftypheic1234", "HEIC files are not read", HEIC_ADVICE),
        ("x.jpg", b"\0\0\0\x18ftypheic1234", "HEIC files are not read", HEIC_ADVICE),
        ("x.heif", b"damaged", "HEIC files are not read", HEIC_ADVICE),
        (
            "x.avif",
            b"\0\0\0\x18ftypavif1234",
            "AVIF files are not read",
            "Convert them to PNG: ffmpeg -i IN.avif OUT.png for each.",
        ),
        ("x.CR2", b"II*\0raw", "camera RAW files are not read", RAW_ADVICE),
        (
            "x.gif",
            b"GIF89a",
            "GIF files are not read",
            "Convert them to PNG: ffmpeg -i IN OUT.png for each.",
        ),
        (
            "x.mts",
            b"video",
            "MTS files are not read",
            "Convert them to MP4: ffmpeg -i IN OUT.mp4 for each.",
        ),
    ],
)
def test_what_cannot_be_used_is_left_out_with_a_reason(folder, name, content, reason, advice):
    written(folder / name, content)
    source = read_source([folder])
    assert names(source) == ["a.png", "b.png"]
    assert only_left_out(source) == LeftOut(name, reason, advice)
    assert source.notes == ()


def test_a_raw_file_with_a_thumbnail_is_no_image(folder):
    photo(folder / "x.dng", content="TIFF")
    assert only_left_out(read_source([folder])).reason == "camera RAW files are not read"


def test_pixels_of_floating_point_are_left_out(folder):
    Image.new("F", (8, 6)).save(folder / "x.tif")
    assert only_left_out(read_source([folder])) == LeftOut(
        "x.tif",
        "the pixels are floating-point numbers",
        "Expected 8 or 16 bits per channel; convert the image to PNG.",
    )


def test_an_image_of_too_many_pixels_is_left_out(folder, monkeypatch):
    photo(folder / "x.png", (40, 30))
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    assert only_left_out(read_source([folder])) == LeftOut(
        "x.png", "it has too many pixels to be decoded safely", "Shrink all images by one factor."
    )


def test_a_link_to_nowhere_is_left_out(folder):
    (folder / "x.png").symlink_to(folder / "gone.png")
    assert only_left_out(read_source([folder])) == LeftOut(
        "x.png", "the file cannot be read (No such file or directory)", "Replace it."
    )


def test_the_later_of_two_equal_files_is_left_out(folder):
    shutil.copy(folder / "a.png", folder / "a (1).png")
    (folder / "sub").mkdir()
    shutil.copy(folder / "b.png", folder / "sub" / "b.png")
    source = read_source([folder])
    assert names(source) == ["a (1).png", "b.png"]
    assert source.images.left_out == (
        LeftOut("a.png", "it is the same file as a (1).png"),
        LeftOut("sub/b.png", "it is the same file as b.png"),
    )


def test_equal_videos_are_used_once(tmp_path):
    written(tmp_path / "a.mp4", b"video")
    written(tmp_path / "b.mp4", b"video")
    source = read_source([tmp_path])
    assert source.videos == (tmp_path / "a.mp4",)
    assert only_left_out(source) == LeftOut("b.mp4", "it is the same file as a.mp4")


def test_raw_files_beside_images_of_the_same_shot_need_no_advice(folder):
    written(folder / "a.NEF", b"raw")
    written(folder / "A.heic", b"heic")
    assert [str(item.reason) for item in read_source([folder]).images.left_out] == [
        "HEIC files are not read; a.png is used",
        "camera RAW files are not read; a.png is used",
    ]
    assert {item.advice for item in read_source([folder]).images.left_out} == {""}


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


def refusal(*paths: Path) -> str:
    with pytest.raises(DataError) as caught:
        read_source(paths)
    return str(caught.value)


def test_a_poster_beside_a_video_does_not_make_it_a_live_photo(folder):
    video = written(folder / "a.mp4", b"video")
    assert read_source([folder]).videos == (video,)


def test_a_path_that_is_not_there_is_refused_with_the_nearest(folder):
    path = folder.parent / "shosts"
    assert refusal(path) == f"{path}: there is no such file or folder.\nDid you mean 'shots'?"
    path = folder.parent / "gone" / "x"
    assert refusal(folder, path) == (
        f"{path}: there is no such file or folder.\nGive a folder of photos, or a video."
    )


def test_an_empty_folder_is_refused(tmp_path):
    assert refusal(tmp_path) == (
        f"{tmp_path}: there is no image and no video that can be used; found no files.\n"
        "Give a folder of PNG, JPEG, WEBP, TIFF or BMP images, or a video (.mp4, .mov, .avi, "
        ".mkv, .webm, .m4v)."
    )


def test_a_folder_without_anything_usable_says_what_is_in_it(tmp_path):
    for number in range(3):
        written(tmp_path / f"{number}.heic", b"heic")
    written(tmp_path / "x.jpg", b"")
    written(tmp_path / "list.csv", b"1,2")
    assert refusal(tmp_path) == (
        f"{tmp_path}: there is no image and no video that can be used; found 3 x HEIC files are "
        "not read; 1 x the file is empty (0 bytes); 1 x they are no images and no videos, by "
        f"their names and contents.\n{HEIC_ADVICE}\nCopy it again from the camera."
    )


def test_a_single_file_that_is_no_image_is_refused(tmp_path):
    path = written(tmp_path / "notes.txt", b"text")
    assert refusal(path) == (
        f"{path}: there is no image and no video that can be used; found 1 x it is no PNG, "
        "JPEG, WEBP, TIFF or BMP image, by its content.\nReplace or remove it."
    )


def test_a_folder_that_cannot_be_read_is_refused(tmp_path, monkeypatch):
    def refuse(self: Path):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "iterdir", refuse)
    assert refusal(tmp_path) == (
        f"{tmp_path}: the folder cannot be read (Permission denied).\n"
        "Make it readable, or take it out of the input."
    )


def test_one_image_is_no_error_here(tmp_path):
    assert names(read_source([photo(tmp_path / "a.png")])) == ["a.png"]
