"""Panoramas among photos: those that say so, and those that only look like one."""

import re

import numpy as np
import pytest
from PIL import Image
from support.panorama import colored, panorama, view
from support.source_photos import names, photo

from gsfw.datamanagers.images import read_header
from gsfw.preparation.exif import Exif
from gsfw.preparation.foreign_formats import CUT_PANORAMA
from gsfw.preparation.image_set import ImageSet, SourceImage
from gsfw.preparation.panorama import panorama_notes
from gsfw.preparation.source import read_source

XMP = (
    b'<x:xmpmeta><rdf:Description xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" '
    b'GPano:ProjectionType="equirectangular"/></x:xmpmeta>'
)


def wide(width=640, height=320) -> Image.Image:
    return Image.fromarray(colored(panorama())).resize((width, height), Image.Resampling.BOX)


def notes_of(path) -> list[str]:
    image = SourceImage("a.jpg", path, read_header(path), Exif())
    return list(panorama_notes(ImageSet((image,))))


def test_a_photo_that_says_it_is_a_panorama_is_left_out(tmp_path):
    photo(tmp_path / "a.png")
    wide().save(tmp_path / "x.jpg", xmp=XMP)
    wide(640, 240).save(tmp_path / "y.jpg", xmp=XMP)  # A view that was cut out of one.
    wide().save(tmp_path / "z.insp", "JPEG")
    source = read_source([tmp_path])
    assert names(source) == ["a.png", "y.jpg"]
    panorama_file, fisheyes = source.images.left_out
    assert panorama_file.reason == "360-degree panorama (equirectangular) files are not read"
    assert "v360=e:flat:yaw=0:h_fov=90:v_fov=90:w=1200:h=1200" in panorama_file.advice
    assert fisheyes.reason == "INSP files are not read"
    assert "two circles" in fisheyes.advice


def test_ffmpeg_takes_the_filter_of_each_advised_view():
    av = pytest.importorskip("av")
    turns = re.findall(r"-?\d+", CUT_PANORAMA.partition(":")[0])
    assert [int(turn) % 360 for turn in turns] == [240, 300, 0, 60, 120, 180]
    (options,) = re.findall(r"v360=(\S+)", CUT_PANORAMA)
    for turn in turns:
        av.filter.Graph().add("v360", options.replace("yaw=0", f"yaw={turn}"))


def test_edges_that_continue_each_other_are_named(tmp_path):
    wide().save(tmp_path / "a.jpg")
    (note,) = notes_of(tmp_path / "a.jpg")
    assert note.startswith("images look like panoramas of 360 degrees")


@pytest.mark.parametrize("left", range(0, 1200, 300))
def test_a_wide_view_of_a_pinhole_is_no_panorama(tmp_path, left):
    Image.fromarray(colored(view(left)[:160])).save(tmp_path / "a.jpg")
    assert notes_of(tmp_path / "a.jpg") == []


def test_a_plain_backdrop_is_no_panorama(tmp_path):
    pixels = np.full((160, 320, 3), 200, np.uint8)
    pixels[60:100, 140:180] = colored(view(0))[:40, :40]
    Image.fromarray(pixels).save(tmp_path / "a.jpg")
    assert notes_of(tmp_path / "a.jpg") == []
