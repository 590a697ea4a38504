"""What of a source cannot be used, and why."""

import shutil

import pytest
from PIL import Image
from support.source_photos import HEIC_ADVICE, names, only_left_out, photo, written

from gsfw.preparation.foreign_formats import AVIF
from gsfw.preparation.image_set import LeftOut
from gsfw.preparation.source import read_source

RAW_ADVICE = (
    "Develop all of them with the same settings, and uncropped, to JPEG, PNG or TIFF: with the "
    "camera's own program, or darktable-cli IN OUT.jpg for each."
)
IMAGE_ADVICE = "Convert them to PNG: ffmpeg -i IN -frames:v 1 OUT.png for each."
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
            AVIF.advice,
        ),
        ("x.CR2", b"II*\0raw", "camera RAW files are not read", RAW_ADVICE),
        (
            "x.gif",
            b"GIF89a",
            "GIF files are not read",
            "Convert them to PNG: ffmpeg -i IN -frames:v 1 OUT.png for each.",
        ),
        ("x.jpg", b"GIF89a", "GIF files are not read", IMAGE_ADVICE),
        ("x.jpg", b"\xff\x0a12345678", "JXL files are not read", IMAGE_ADVICE),
        ("x.png", b"\0\0\0\x0cjP  \r\n\x87\n", "JP2 files are not read", IMAGE_ADVICE),
        ("x.jpg", b"\0\0\0\x18ftypcrx 1234", "camera RAW files are not read", RAW_ADVICE),
        (
            "x.jpg",
            b"\0\0\0\x18ftypisom1234",
            "misnamed video files are not read",
            "Name them .mp4 or .mov to use their frames.",
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


def test_a_link_to_itself_is_left_out(folder):
    (folder / "x.png").symlink_to(folder / "x.png")
    item = only_left_out(read_source([folder]))
    assert (item.name, item.advice) == ("x.png", "Replace it.")
    assert item.reason.startswith("the file cannot be read (")


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


def test_raw_files_beside_images_of_the_same_shot_need_no_advice(folder):
    written(folder / "a.NEF", b"raw")
    written(folder / "A.heic", b"heic")
    assert [str(item.reason) for item in read_source([folder]).images.left_out] == [
        "HEIC files are not read; a.png is used",
        "camera RAW files are not read; a.png is used",
    ]
    assert {item.advice for item in read_source([folder]).images.left_out} == {""}


@pytest.mark.parametrize("name", ["a.insp", "a.insv", "a.360"])
def test_files_that_are_not_stitched_are_left_out_with_a_remedy(tmp_path, name):
    photo(tmp_path / "b.png")
    photo(tmp_path / "c.jpg").rename(tmp_path / name)
    source = read_source([tmp_path])
    assert names(source) == ["b.png"]
    (item,) = source.images.left_out
    assert item.reason == f"{name[2:].upper()} files are not read"
    assert "not stitched" in item.advice
    assert "equirectangular, 2:1" in item.advice
