"""Recognition of panoramas: by their metadata, and by their pixels."""

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage
from support.panorama import colored, panorama, view
from support.panorama_room import FULL_XMP, sphere
from support.sampling import sampled

from gsfw.datamanagers.images import read_header
from gsfw.preparation.panorama import Kind, Look, look_at

CROPPED = FULL_XMP.replace(
    b"/></x:xmpmeta>",
    b' GPano:CroppedAreaImageWidthPixels="640" GPano:CroppedAreaImageHeightPixels="240" '
    b'GPano:FullPanoWidthPixels="1000" GPano:FullPanoHeightPixels="500"/></x:xmpmeta>',
)


def wide(width=640, height=320) -> Image.Image:
    return Image.fromarray(sphere()).resize((width, height), Image.Resampling.BICUBIC)


def look(path, image: Image.Image, xmp: bytes = b"") -> Look:
    image.save(path / "a.jpg", xmp=xmp)
    return look_at(path / "a.jpg", read_header(path / "a.jpg"))


@pytest.mark.parametrize("size", sampled([((640, 320),), ((642, 320),), ((64, 32),)], [1, 2]))
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


def test_a_plain_ceiling_and_floor_hide_no_panorama(tmp_path):
    pixels = sphere().copy()
    pixels[:90], pixels[170:] = 240, 110
    assert look(tmp_path, Image.fromarray(pixels)) == Look(Kind.PANORAMA)


def test_the_edge_of_a_door_at_the_seam_hides_no_panorama(tmp_path):
    pixels = sphere().astype(float)
    pixels[80:180, -90:] = 0.3 * pixels[80:180, -90:] + 150
    assert look(tmp_path, Image.fromarray(pixels.astype(np.uint8))) == Look(Kind.PANORAMA)


def test_a_patch_over_the_tripod_hides_no_panorama(tmp_path):
    pixels = sphere().copy()
    pixels[230:] = 60 + pixels[140:166] // 2
    assert look(tmp_path, Image.fromarray(pixels)) == Look(Kind.PANORAMA)


def test_a_texture_that_repeats_is_no_panorama(tmp_path):
    middle = sphere()[64:192]
    pixels = np.concatenate([middle, middle[::-1]])
    assert look(tmp_path, Image.fromarray(pixels)) == Look(Kind.VIEW)


def test_recognition_does_not_depend_on_size_and_format(tmp_path):
    pixels = sphere().repeat(4, axis=0).repeat(4, axis=1).astype(float)
    pixels += np.random.default_rng(0).normal(0, 40, pixels.shape)
    Image.fromarray(pixels.clip(0, 255).astype(np.uint8)).save(tmp_path / "a.png")
    assert look_at(tmp_path / "a.png", read_header(tmp_path / "a.png")) == Look(Kind.PANORAMA)


def test_two_black_circles_are_those_of_two_fisheyes(tmp_path):
    y, x = np.mgrid[:320, :640] + 0.5
    outside = np.hypot(x % 320 - 160, y - 160) > 160
    pixels = np.where(outside[..., None], 0, np.asarray(wide())).astype(np.uint8)
    assert look(tmp_path, Image.fromarray(pixels)) == Look(Kind.FISHEYES)


@pytest.mark.parametrize("left", range(0, 1200, 300))
def test_a_wide_view_of_a_pinhole_is_no_panorama(tmp_path, left):
    assert look(tmp_path, Image.fromarray(colored(view(left)[:160]))) == Look(Kind.VIEW)


ACROSS, DOWN = np.meshgrid(np.linspace(-1, 1, 512), np.linspace(-1, 1, 256))
BACKDROPS = {
    "black": np.zeros((256, 512)),
    "white": np.full((256, 512), 255.0),
    "gradient": 120 + 100 * DOWN,
    "vignette": 220 - 70 * np.hypot(ACROSS, DOWN),
    "clouds": 120
    + 400 * ndimage.gaussian_filter(np.random.default_rng(0).normal(size=(256, 512)), 8),
}


@pytest.mark.parametrize("noise", [0.0, 8.0])
@pytest.mark.parametrize("radius", [0.3, 0.9, 1.05])
@pytest.mark.parametrize("backdrop", BACKDROPS)
def test_an_object_before_a_backdrop_is_a_view(tmp_path, backdrop, radius, noise):
    grey = BACKDROPS[backdrop] + np.random.default_rng(1).normal(0, noise, (256, 512))
    inside = np.hypot(2 * ACROSS, DOWN) < radius
    grey = np.where(inside, panorama()[:256, :512], grey)
    assert look(tmp_path, Image.fromarray(colored(grey))) == Look(Kind.VIEW)


def test_transparent_pixels_of_any_colour_are_no_content(tmp_path):
    alpha = np.where(np.hypot(2 * ACROSS, DOWN) < 0.9, 255, 0).astype(np.uint8)
    Image.fromarray(np.dstack([sphere(), alpha])).save(tmp_path / "a.png")
    assert look_at(tmp_path / "a.png", read_header(tmp_path / "a.png")) == Look(Kind.VIEW)


def test_a_plain_table_seen_from_its_middle_is_a_view(tmp_path):
    grey = np.where(0.8 * np.abs(ACROSS) - 0.9 < DOWN, 255, 0)
    inside = np.hypot(2 * ACROSS, DOWN) < 0.4
    grey = np.where(inside, panorama()[:256, :512], grey)
    assert look(tmp_path, Image.fromarray(colored(grey))) == Look(Kind.VIEW)


@pytest.mark.parametrize("centers", [(0.0,), (-0.5, 0.5)])
def test_objects_before_black_are_no_fisheyes(tmp_path, centers):
    inside = np.any([np.hypot(3 * (ACROSS - one), DOWN) < 0.95 for one in centers], axis=0)
    pixels = np.where(inside, panorama()[:256, :512], 0)
    assert look(tmp_path, Image.fromarray(colored(pixels))) == Look(Kind.VIEW)


def test_a_file_that_is_gone_is_a_view(tmp_path):
    wide().save(tmp_path / "a.jpg")
    header = read_header(tmp_path / "a.jpg")
    (tmp_path / "a.jpg").unlink()
    assert look_at(tmp_path / "a.jpg", header) == Look(Kind.VIEW)
