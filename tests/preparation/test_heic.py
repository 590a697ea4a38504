"""HEIC photos become JPEG files of a preparation."""

import io
import sys
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base
from support import color_profiles
from support.heic_files import write_heic
from support.source_photos import (
    GREEN,
    HEIC_ADVICE,
    RED,
    names,
    only_left_out,
    photo,
    red_and_green,
    written,
)

from gsfw.core.errors import DataError
from gsfw.datamanagers.coded_colors import PQ, coded_to_srgb
from gsfw.datamanagers.color_profile import in_srgb
from gsfw.datamanagers.images import decode
from gsfw.preparation import photo_conversion
from gsfw.preparation.photo_conversion import _jpeg_of_heic
from gsfw.preparation.source import read_source

pytest.importorskip("pi_heif", reason="pi-heif, which decodes HEIC, is not installed")

CODING = 6
"""Deviation that HEVC and JPEG cause inside of areas of one colour, of 255."""


def exif() -> bytes:
    """EXIF data of a phone."""
    data = Image.Exif()
    data[Base.Make], data[Base.Orientation] = "Phone", 6
    data[IFD.Exif] = {Base.FocalLengthIn35mmFilm: 26}
    return data.tobytes()


def source(folder: Path):
    return read_source([folder], converted=folder.parent / "converted")


def test_a_heic_photo_is_upright_and_has_its_name_and_exif_data(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    write_heic(folder / "IMG_1.HEIC", red_and_green(), exif(), turns=3)
    found = source(folder)
    (image,) = found.images.images
    assert image.name == "IMG_1.jpg"
    assert (image.header.width, image.header.height, image.header.orientation) == (48, 64, 1)
    assert (image.exif.make, image.exif.focal_35mm) == ("Phone", 26)
    shown = decode(image.path, image.header).astype(int)
    # A quarter turn counter-clockwise, three times: the left side comes up.
    assert np.abs(shown[10, 24] - RED).max() <= CODING
    assert np.abs(shown[50, 24] - GREEN).max() <= CODING
    assert found.notes == ("HEIC photos are converted to JPEG (quality 97): 1",)


def test_colors_of_a_profile_become_srgb(tmp_path):
    profile = color_profiles.profile(color_profiles.DISPLAY_P3)
    path = write_heic(tmp_path / "a.heic", red_and_green(), profile=profile)
    shown = opened(_jpeg_of_heic(path))
    expected = np.asarray(in_srgb(Image.fromarray(red_and_green()), "RGB", profile)).astype(int)
    assert np.abs(expected - red_and_green()).max() > 2 * CODING
    for column in (10, 50):
        assert np.abs(shown[20, column] - expected[20, column]).max() <= CODING


def test_photos_of_a_coded_colors_become_srgb(tmp_path):
    image = np.full((48, 64, 3), (130, 100, 110), np.uint8)
    for transfer in (PQ, 13):  # 13: the curve of sRGB, with primaries of BT.2020.
        shown = opened(_jpeg_of_heic(write_heic(tmp_path / "a.hif", image, transfer=transfer)))
        expected = coded_to_srgb(image.astype(np.uint16) * 257, transfer, 9).astype(int)
        assert np.abs(shown - expected).max() <= CODING


def opened(content: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(content)) as image:
        return np.asarray(image).astype(int)


def test_a_second_preparation_keeps_the_converted_photos(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    write_heic(folder / "a.jpg", red_and_green())
    (before,) = source(folder).images.images
    with before.path.open("r+b") as file:
        file.write(before.path.read_bytes())
    changed = before.path.stat().st_mtime_ns
    (after,) = source(folder).images.images
    assert after.path == before.path
    assert after.path.stat().st_mtime_ns == changed


def test_a_shot_that_the_camera_also_wrote_as_jpeg_is_not_converted(tmp_path):
    folder = tmp_path / "photos"
    photo(folder / "a.jpg")
    write_heic(folder / "A.heic", red_and_green())
    found = source(folder)
    assert names(found) == ["a.jpg"]
    assert only_left_out(found).reason == "HEIC files are not read; a.jpg is used"


def test_a_damaged_file_is_left_out_with_the_reason(tmp_path):
    folder = tmp_path / "photos"
    photo(folder / "a.jpg")
    whole = write_heic(folder / "b.heic", red_and_green()).read_bytes()
    (folder / "b.heic").write_bytes(whole[:-60])
    left_out = only_left_out(source(folder))
    assert (left_out.name, left_out.reason, left_out.advice) == (
        "b.heic",
        "the HEIC image is damaged, or of a kind that pi-heif does not decode",
        "Copy it again, or convert it to JPEG.",
    )


def test_several_photos_keep_their_order_whichever_is_decoded_first(tmp_path, monkeypatch):
    folder = tmp_path / "photos"
    folder.mkdir()
    for number, name in enumerate("abcd", 1):
        write_heic(folder / f"{name}.heic", red_and_green() // number)
    (folder / "b.heic").write_bytes((folder / "b.heic").read_bytes()[:-60])
    monkeypatch.setattr("gsfw.preparation.photo_conversion.cores", lambda: 2)
    other_is_done = Event()
    decode_one = photo_conversion._jpeg_of_heic

    def slow_first(path):
        if path.name == "a.heic":
            assert other_is_done.wait(10), "the others are decoded meanwhile"
        found = decode_one(path)
        if path.name == "c.heic":
            other_is_done.set()
        return found

    monkeypatch.setattr(photo_conversion, "_jpeg_of_heic", slow_first)
    found = source(folder)
    assert names(found) == ["a.jpg", "c.jpg", "d.jpg"]
    assert only_left_out(found).name == "b.heic"


def test_the_clip_of_a_live_photo_is_still_known(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    write_heic(folder / "IMG_1.HEIC", red_and_green())
    written(folder / "IMG_1.MOV", b"clip")
    assert only_left_out(source(folder)).reason == "it is the clip of the live photo IMG_1.jpg"


def test_without_the_decoder_its_name_is_told(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pi_heif", None)
    folder = tmp_path / "photos"
    folder.mkdir()
    write_heic(folder / "a.heic", red_and_green())
    with pytest.raises(DataError) as caught:
        source(folder)
    assert caught.value.advice == HEIC_ADVICE
    assert "pip install 'gsfw[heic]'" in HEIC_ADVICE
