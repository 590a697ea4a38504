"""AVIF photos become JPEG files of a preparation."""

import io
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, features
from PIL.ExifTags import Base
from support import color_profiles
from support.source_photos import GREEN, RED, names, only_left_out, photo, red_and_green

from gsfw.core.errors import DataError
from gsfw.datamanagers.coded_colors import PQ, coded_to_srgb
from gsfw.datamanagers.color_profile import in_srgb
from gsfw.datamanagers.images import decode
from gsfw.preparation import photo_conversion
from gsfw.preparation.photo_conversion import COLOR_CODES
from gsfw.preparation.source import read_source

pytestmark = pytest.mark.skipif(
    "avif" not in features.modules or not features.check_module("avif"),
    reason="this Pillow does not decode AVIF",
)

CODING = 6
"""Deviation that AV1 and JPEG cause inside of areas of one colour, of 255."""


def write_avif(path: Path, profile: bytes = b"", orientation: int = 1) -> Path:
    path.parent.mkdir(exist_ok=True)
    exif = Image.Exif()
    exif[Base.Make], exif[Base.Orientation] = "Phone", orientation
    content = io.BytesIO()
    Image.fromarray(red_and_green()).save(
        content, "AVIF", quality=95, speed=9, exif=exif, icc_profile=profile or None
    )
    path.write_bytes(content.getvalue())
    return path


def shown(folder: Path) -> np.ndarray:
    (image,) = read_source([folder], converted=folder.parent / "converted").images.images
    return decode(image.path, image.header).astype(int)


def test_an_avif_photo_is_upright_and_has_its_name_and_exif_data(tmp_path):
    folder = tmp_path / "photos"
    write_avif(folder / "IMG_1.avif", orientation=8)
    found = read_source([folder], converted=tmp_path / "converted")
    (image,) = found.images.images
    assert image.name == "IMG_1.jpg"
    assert (image.header.width, image.header.height, image.header.orientation) == (48, 64, 1)
    assert image.exif.make == "Phone"
    # A quarter turn counter-clockwise: the right side comes up.
    assert np.abs(shown(folder)[10, 24] - GREEN).max() <= CODING
    assert np.abs(shown(folder)[50, 24] - RED).max() <= CODING
    assert found.notes == ("AVIF photos are converted to JPEG (quality 97): 1",)


def test_colors_of_a_profile_become_srgb(tmp_path):
    profile = color_profiles.profile(color_profiles.DISPLAY_P3)
    write_avif(tmp_path / "photos/a.jpg", profile)
    expected = np.asarray(in_srgb(Image.fromarray(red_and_green()), "RGB", profile)).astype(int)
    assert np.abs(expected - red_and_green()).max() > 2 * CODING
    for column in (10, 50):
        found = shown(tmp_path / "photos")[20, column]
        assert np.abs(found - expected[20, column]).max() <= CODING


def test_photos_of_coded_colors_become_srgb(tmp_path):
    path = write_avif(tmp_path / "photos/a.avif")
    before, box, after = path.read_bytes().partition(COLOR_CODES)
    path.write_bytes(before + box + struct.pack(">2H", 9, PQ) + after[4:])
    expected = coded_to_srgb(red_and_green().astype(np.uint16) * 257, PQ, 9).astype(int)
    assert np.abs(expected - red_and_green()).max() > 2 * CODING
    for column in (10, 50):
        found = shown(tmp_path / "photos")[20, column]
        assert np.abs(found - expected[20, column]).max() <= 2 * CODING


def test_a_damaged_file_is_left_out_with_the_reason(tmp_path):
    folder = tmp_path / "photos"
    photo(folder / "a.jpg")
    path = write_avif(folder / "b.avif")
    path.write_bytes(path.read_bytes()[:-60])
    left_out = only_left_out(read_source([folder], converted=tmp_path / "converted"))
    assert (left_out.name, left_out.reason) == (
        "b.avif",
        "the AVIF image is damaged, or of a kind that Pillow does not decode",
    )


def test_a_shot_that_the_camera_also_wrote_as_jpeg_is_not_converted(tmp_path):
    folder = tmp_path / "photos"
    photo(folder / "a.jpg")
    write_avif(folder / "A.avif")
    found = read_source([folder], converted=tmp_path / "converted")
    assert names(found) == ["a.jpg"]
    assert only_left_out(found).reason == "AVIF files are not read; a.jpg is used"


def test_without_the_decoder_pillow_is_named_with_the_version_that_has_it(tmp_path, monkeypatch):
    monkeypatch.setattr(photo_conversion.features, "modules", {})
    write_avif(tmp_path / "photos/a.avif")
    with pytest.raises(DataError) as caught:
        read_source([tmp_path / "photos"], converted=tmp_path / "converted")
    assert caught.value.advice.startswith("This Pillow has no AVIF decoder; ")
