"""Colour profiles of photos: conversion to sRGB, and profiles that are not applied."""

import numpy as np
import PIL
import pytest
from packaging.version import Version
from PIL import Image, ImageCms, TiffImagePlugin, TiffTags
from PIL.ExifTags import IFD, Base, Interop
from PIL.PngImagePlugin import PngInfo
from support.color_profiles import (
    ADOBE_RGB,
    DISPLAY_P3,
    SRGB,
    grey_profile,
    ink_profile,
    profile,
    srgb_of,
)

from gsfw.datamanagers.images import decode, read_header

COLORS = np.random.default_rng(5).integers(0, 256, (16, 24, 3), np.uint8)


def decoded(path, pixels, **settings) -> np.ndarray:
    Image.fromarray(pixels).save(path, **settings)
    return decode(path, read_header(path))


@pytest.mark.parametrize("suffix", ["png", "tif", "webp"])
@pytest.mark.parametrize("primaries", [DISPLAY_P3, ADOBE_RGB], ids=["Display P3", "Adobe RGB"])
def test_photos_in_wide_spaces_become_srgb(tmp_path, primaries, suffix):
    settings = {"lossless": True} if suffix == "webp" else {}
    path = tmp_path / f"a.{suffix}"
    found = decoded(path, COLORS, icc_profile=profile(primaries), **settings)
    assert np.abs(found - srgb_of(COLORS, primaries)).max() < 2.5
    assert np.abs(found.astype(int) - COLORS).max() > 20


def test_a_jpeg_at_a_fraction_of_its_size_is_converted_too(tmp_path):
    path = tmp_path / "a.jpg"
    Image.new("RGB", (64, 48), (250, 60, 40)).save(
        path, quality=98, icc_profile=profile(DISPLAY_P3)
    )
    small = decode(path, read_header(path), (16, 12))
    assert small.shape == (12, 16, 3)
    assert np.abs(small[6, 8] - srgb_of((250, 60, 40), DISPLAY_P3)).max() < 4


def test_alpha_stays_as_it_is(tmp_path):
    alpha = np.arange(16 * 24, dtype=np.uint16).reshape(16, 24, 1).astype(np.uint8)
    pixels = np.concatenate([COLORS, alpha], axis=2)
    found = decoded(tmp_path / "a.png", pixels, icc_profile=profile(DISPLAY_P3))
    assert np.array_equal(found[..., 3:], alpha)
    assert np.abs(found[..., :3] - srgb_of(COLORS, DISPLAY_P3)).max() < 2.5


def test_numbers_of_srgb_keep_their_bits(tmp_path):
    own = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    assert np.array_equal(decoded(tmp_path / "a.png", COLORS, icc_profile=own), COLORS)


def test_a_tiff_with_a_number_in_place_of_its_profile_is_read_as_it_is(tmp_path):
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    tags[34675] = 1
    tags.tagtype[34675] = TiffTags.SHORT
    assert np.array_equal(decoded(tmp_path / "a.tif", COLORS, tiffinfo=tags), COLORS)


@pytest.mark.parametrize(
    "given",
    [b"no profile", profile(DISPLAY_P3)[:200], profile(SRGB, b"GRAY")],
    ids=["no profile", "cut off", "of grey"],
)
def test_a_profile_that_does_not_fit_is_not_applied(tmp_path, given):
    assert np.array_equal(decoded(tmp_path / "a.png", COLORS, icc_profile=given), COLORS)


def adobe_exif(space, index) -> Image.Exif:
    exif = Image.Exif()
    exif.get_ifd(IFD.Exif)[Base.ColorSpace] = space
    exif.get_ifd(IFD.Exif)[Base.ExifInteroperabilityOffset] = {Interop.InteropIndex: index}
    return exif


writes_all = pytest.mark.skipif(
    Version(PIL.__version__) < Version("11.2"),
    reason="this Pillow writes neither EXIF with such parts nor all chunks of PNG",
)


@writes_all
@pytest.mark.parametrize(
    ("space", "index", "converted"),
    [(65535, "R03", True), (2, "R98", True), (65535, "R98", False), (1, "R03", False)],
)
def test_adobe_rgb_that_only_exif_names_becomes_srgb(tmp_path, space, index, converted):
    path = tmp_path / "a.png"
    found = decoded(path, COLORS, exif=adobe_exif(space, index).tobytes())
    wanted = srgb_of(COLORS, ADOBE_RGB) if converted else COLORS
    assert np.abs(found - wanted).max() < 2.5
    assert np.array_equal(decode(path, read_header(path), as_stored=True), COLORS)
    opaque = np.concatenate([COLORS, np.full_like(COLORS[..., :1], 255)], -1)
    found = decoded(path, opaque, exif=adobe_exif(space, index).tobytes())
    assert np.abs(found[..., :3] - wanted).max() < 2.5


@pytest.mark.parametrize("alpha", [False, True])
def test_a_profile_of_grey_is_applied(tmp_path, alpha):
    grey = np.repeat(np.arange(256, dtype=np.uint8)[None], 4, axis=0)
    pixels = np.stack([grey, grey[:, ::-1]], axis=2) if alpha else grey
    found = decoded(tmp_path / "a.png", pixels, icc_profile=grey_profile(1.5))
    linear = (grey / 255) ** 1.5
    wanted = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    assert np.abs(found[..., 0] - 255 * wanted)[:, 8:].max() < 1.5
    assert np.array_equal(found[..., 0], found[..., 2])
    assert not alpha or np.array_equal(found[..., 3], grey[:, ::-1])


def test_16_bits_of_grey_are_converted_by_their_profile(tmp_path):
    grey = np.full((2, 3), 16384, np.uint16)
    found = decoded(tmp_path / "a.png", grey, icc_profile=grey_profile(1.0))
    assert np.unique(found).tolist() == [137]


def test_a_profile_of_cmyk_is_applied(tmp_path):
    path = tmp_path / "a.tif"
    Image.new("CMYK", (4, 4), (0, 0, 0, 255)).save(path, icc_profile=ink_profile())
    header = read_header(path)
    assert not header.unconverted
    assert np.unique(decode(path, header)).tolist() == [94]  # L* = 40, where ink is not black.
    assert decode(path, header, as_stored=True).max() == 0
    Image.new("CMYK", (4, 4), (0, 0, 0, 0)).save(path, icc_profile=ink_profile())
    assert decode(path, header).min() > 250


def png_of_space(path, name, content) -> str:
    info = PngInfo()
    info.add(name, content)
    Image.fromarray(COLORS).save(path, pnginfo=info)
    return read_header(path).unconverted


@writes_all
def test_colours_of_a_png_that_are_not_converted_are_named(tmp_path):
    path = tmp_path / "a.png"
    assert png_of_space(path, b"cICP", bytes([9, 16, 0, 1])) == "HDR (PQ)"
    assert png_of_space(path, b"cICP", bytes([1, 1, 0, 1])) == ""
    linear = (100_000).to_bytes(4, "big")
    assert png_of_space(path, b"gAMA", linear) == "a gamma of 1"
    assert png_of_space(path, b"gAMA", (45_455).to_bytes(4, "big")) == ""
    wide = b"".join(
        v.to_bytes(4, "big") for v in (31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)
    )
    assert "primaries" in png_of_space(path, b"cHRM", wide)
    assert np.array_equal(decode(path, read_header(path)), COLORS)


def test_damaged_profiles_and_inks_without_one_are_named(tmp_path):
    Image.fromarray(COLORS).save(tmp_path / "a.png", icc_profile=b"no profile")
    assert "cannot be applied" in read_header(tmp_path / "a.png").unconverted
    Image.new("CMYK", (4, 4)).save(tmp_path / "a.jpg")
    assert read_header(tmp_path / "a.jpg").unconverted == "CMYK without a colour profile"
