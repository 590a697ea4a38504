"""Recognition of panoramas: by their metadata, and by their pixels."""

import numpy as np
import pytest
from PIL import Image
from support.panorama import colored, panorama, view
from support.panorama_room import FULL_XMP

from gsfw.datamanagers.images import read_header
from gsfw.preparation.panorama import Kind, Look, look_at

CROPPED = FULL_XMP.replace(
    b"/></x:xmpmeta>",
    b' GPano:CroppedAreaImageWidthPixels="640" GPano:CroppedAreaImageHeightPixels="240" '
    b'GPano:FullPanoWidthPixels="1000" GPano:FullPanoHeightPixels="500"/></x:xmpmeta>',
)


def wide(width=640, height=320) -> Image.Image:
    return Image.fromarray(colored(panorama())).resize((width, height), Image.Resampling.BOX)


def look(path, image: Image.Image, xmp: bytes = b"") -> Look:
    image.save(path / "a.jpg", xmp=xmp)
    return look_at(path / "a.jpg", read_header(path / "a.jpg"))


@pytest.mark.parametrize("size", [(640, 320), (642, 320), (64, 32)])
def test_metadata_tell_a_panorama_of_about_two_to_one(tmp_path, size):
    assert look(tmp_path, wide(*size), FULL_XMP) == Look(Kind.PANORAMA, is_said=True)


def test_a_view_that_kept_the_metadata_of_its_panorama_is_a_view(tmp_path):
    assert look(tmp_path, wide(640, 240), FULL_XMP) == Look(Kind.VIEW)
    assert look(tmp_path, wide(300, 300), CROPPED) == Look(Kind.VIEW)


@pytest.mark.parametrize("form", ['GPano:{}="{}"', "<GPano:{0}>{1}</GPano:{0}>"])
def test_metadata_tell_a_part_of_a_panorama(tmp_path, form):
    sizes = {
        "CroppedAreaImageWidthPixels": 640,
        "CroppedAreaImageHeightPixels": 240,
        "FullPanoWidthPixels": 1000,
        "FullPanoHeightPixels": 500,
    }
    xmp = "equirectangular" + " ".join(form.format(*pair) for pair in sizes.items())
    assert look(tmp_path, wide(640, 240), xmp.encode()) == Look(Kind.PART, is_said=True)


def test_edges_that_continue_each_other_tell_a_panorama(tmp_path):
    assert look(tmp_path, wide()) == Look(Kind.PANORAMA)


def test_two_black_circles_are_those_of_two_fisheyes(tmp_path):
    y, x = np.mgrid[:320, :640] + 0.5
    outside = np.hypot(x % 320 - 160, y - 160) > 160
    pixels = np.where(outside[..., None], 0, np.asarray(wide())).astype(np.uint8)
    assert look(tmp_path, Image.fromarray(pixels)) == Look(Kind.FISHEYES)


@pytest.mark.parametrize("left", range(0, 1200, 300))
def test_a_wide_view_of_a_pinhole_is_no_panorama(tmp_path, left):
    assert look(tmp_path, Image.fromarray(colored(view(left)[:160]))) == Look(Kind.VIEW)


def test_a_plain_backdrop_is_no_panorama(tmp_path):
    pixels = np.full((160, 320, 3), 200, np.uint8)
    pixels[60:100, 140:180] = colored(view(0))[:40, :40]
    assert look(tmp_path, Image.fromarray(pixels)) == Look(Kind.VIEW)


def test_a_file_that_is_gone_is_a_view(tmp_path):
    wide().save(tmp_path / "a.jpg")
    header = read_header(tmp_path / "a.jpg")
    (tmp_path / "a.jpg").unlink()
    assert look_at(tmp_path / "a.jpg", header) == Look(Kind.VIEW)
