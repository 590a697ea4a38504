"""Files of images that are written anew: formats, colour profiles, EXIF."""

import io

import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base
from support.color_profiles import DISPLAY_P3, profile

from gsfw.datamanagers.images import decode_mask, read_header
from gsfw.preparation.writing.image_output import StoredImage, encoded, encoded_mask

PIXELS = np.arange(24 * 16 * 3, dtype=np.uint32).reshape(16, 24, 3).astype(np.uint8)


def stored(path, mode="RGB", **settings) -> StoredImage:
    Image.fromarray(PIXELS).convert(mode).save(path, **settings)
    return StoredImage.read(path, read_header(path))


def rewritten(image: StoredImage) -> Image.Image:
    return Image.open(io.BytesIO(image.rewritten(PIXELS, 95)))


@pytest.mark.parametrize(
    ("suffix", "format_name"),
    [("jpg", "JPEG"), ("png", "PNG"), ("webp", "PNG"), ("tif", "PNG"), ("bmp", "PNG")],
)
def test_jpeg_stays_jpeg_and_all_else_becomes_png(tmp_path, suffix, format_name):
    image = stored(tmp_path / f"a.{suffix}")
    assert rewritten(image).format == image.rewritten_format == format_name
    if format_name == "PNG":
        assert np.array_equal(np.asarray(rewritten(image)), PIXELS)


def test_formats_are_told_by_content(tmp_path):
    Image.fromarray(PIXELS).save(tmp_path / "a.png", "JPEG")
    image = StoredImage.read(tmp_path / "a.png", read_header(tmp_path / "a.png"))
    assert image.format == "JPEG"


def test_several_images_in_one_jpeg_count_as_a_jpeg(tmp_path):
    pixels = Image.fromarray(PIXELS)
    pixels.save(tmp_path / "a.jpg", "MPO", save_all=True, append_images=[pixels])
    image = StoredImage.read(tmp_path / "a.jpg", read_header(tmp_path / "a.jpg"))
    assert image.format == image.rewritten_format == "JPEG"


def test_the_profile_is_left_out_as_decoded_colours_are_srgb(tmp_path):
    image = stored(tmp_path / "a.jpg", icc_profile=profile(DISPLAY_P3))
    assert "icc_profile" not in rewritten(image).info


def test_exif_says_that_rewritten_colours_are_srgb(tmp_path):
    exif = Image.Exif()
    exif[Base.Make] = "A maker"
    exif[IFD.Exif] = {Base.ColorSpace.value: 65535, IFD.Interop.value: {1: "R03"}}
    found = rewritten(stored(tmp_path / "a.jpg", exif=exif)).getexif()
    assert found[Base.Make] == "A maker"
    assert found.get_ifd(IFD.Exif) == {Base.ColorSpace: 1}


def test_exif_that_cannot_be_written_is_dropped(tmp_path):
    exif = Image.Exif()
    exif[Base.Make] = "A maker"
    image = stored(tmp_path / "a.webp", exif=exif)
    assert rewritten(image).getexif()[Base.Make] == "A maker"
    exif[Base.ImageDescription] = "x" * 100_000
    assert not rewritten(stored(tmp_path / "a.png", exif=exif)).getexif()


@pytest.mark.filterwarnings("ignore:Corrupt EXIF data")
def test_broken_exif_is_dropped(tmp_path):
    image = stored(tmp_path / "a.jpg", exif=b"Exif\0\0II*\0\x08\0\0\0\xff\xff")
    assert rewritten(image).format == "JPEG"
    assert not rewritten(image).getexif()


def test_masks_are_read_as_they_were(tmp_path):
    mask = PIXELS[..., 0] > 100
    (tmp_path / "mask.png").write_bytes(encoded_mask(mask))
    assert np.array_equal(decode_mask(tmp_path / "mask.png"), mask)


def test_colours_of_jpegs_are_not_subsampled():
    with Image.open(io.BytesIO(encoded(PIXELS, "JPEG", 95))) as image:
        assert [layer[1:3] for layer in image.layer] == [(1, 1)] * 3
