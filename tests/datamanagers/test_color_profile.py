"""Colour profiles of photos: conversion to sRGB, and profiles that are not applied."""

import numpy as np
import pytest
from PIL import Image, ImageCms, TiffImagePlugin, TiffTags
from support.color_profiles import ADOBE_RGB, DISPLAY_P3, SRGB, profile, srgb_of

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
