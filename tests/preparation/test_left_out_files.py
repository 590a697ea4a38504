"""Files that cannot be used are left out with a reason; a source without any other is refused."""

import shutil
from pathlib import Path

import pytest
from PIL import Image
from support.photo_files import names, only_left_out, photo, photos, written

from gsfw.core.errors import DataError
from gsfw.preparation.image_set import LeftOut
from gsfw.preparation.source import read_source


@pytest.fixture
def folder(tmp_path) -> Path:
    """Two good photos, so that something can be used."""
    return photos(tmp_path / "shots", "a.png", "b.png")


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
