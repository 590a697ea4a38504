"""What decoded images show."""

import numpy as np
import pytest
from PIL import Image, ImageFilter
from support.checked_captures import write_ball

from gsfw.preparation.finding import Weight


def blurred(pixels):
    return np.asarray(Image.fromarray(pixels).filter(ImageFilter.GaussianBlur(3)))


def overexposed(pixels):
    pixels = pixels.copy()
    pixels[8:40, 12:52] = 255
    return pixels


@pytest.fixture
def written(tmp_path):
    return write_ball(tmp_path / "ball")


@pytest.mark.parametrize(
    ("kind", "edit"),
    [
        ("blurred images", blurred),
        ("unlit images", np.zeros_like),
        ("empty images", lambda pixels: np.full_like(pixels, 255)),
        ("uneven exposure", lambda pixels: (0.5 * pixels).astype(np.uint8)),
        (
            "clipped images",
            overexposed,
        ),
    ],
)
def test_bad_images_are_named(written, kind, edit):
    bad = (3, 7, 12)
    written.change(bad, lambda pixels: edit(pixels).astype(np.uint8))
    found = written.findings()[kind]
    assert found.weight is Weight.LIMIT
    assert {f"view_{view:03d}.png" for view in bad} <= set(found.images)


def test_a_capture_that_is_blurred_as_a_whole_is_told(written):
    written.change(range(24), lambda pixels: blurred(blurred(blurred(pixels))))
    found = written.findings()
    assert "all images blurred" in found
    assert "blurred images" not in found


def test_images_without_anything_do_not_train(written):
    written.change(range(24), lambda pixels: np.full_like(pixels, 90))
    assert written.findings()["empty images"].weight is Weight.STOP


def test_an_image_that_does_not_decode_is_named(written):
    path = written.folder / "images" / "view_004.png"
    path.write_bytes(path.read_bytes()[:2000])
    found = written.findings()["damaged images"]
    assert (found.weight, found.images) == (Weight.STOP, ("view_004.png",))
    assert found.found.startswith("1 of 24 images do not decode: ")
    assert str(path) in found.found


def test_the_same_image_twice_is_named(written):
    first = np.asarray(Image.open(written.folder / "images" / "view_002.png"))
    written.change([9], lambda pixels: first)
    found = written.findings()["copies"]
    assert found.images == ("view_009.png",)
    assert "view_009.png is view_002.png" in found.found


def test_a_sample_is_spread_evenly_and_said_so(written):
    sample = written.survey(5).sample
    assert (sample.tried, sample.total) == (5, 24)
    assert len({image.view // 5 for image in sample.images}) >= 4
    assert written.survey(0).sample.tried == 24


def test_exif_orientation_is_a_note(written):
    for view in range(24):
        path = written.folder / "images" / f"view_{view:03d}.png"
        image = Image.open(path)
        exif = Image.Exif()
        exif[274] = 3
        image.save(path, exif=exif)
    found = written.findings()["turned images"]
    assert (found.weight, len(found.images)) == (Weight.NOTE, 24)


def test_masks_that_leave_nothing_of_an_image_are_told(written):
    (written.folder / "masks").mkdir()
    for view in range(24):
        mask = np.zeros((48, 64), np.uint8) if view == 6 else np.full((48, 64), 255, np.uint8)
        Image.fromarray(mask).save(written.folder / "masks" / f"view_{view:03d}.png")
    assert written.findings()["nothing left of images"].images == ("view_006.png",)


@pytest.mark.slow
def test_one_border_colour_is_a_background(written):
    from gsfw.preparation.check.plan import plain_background

    assert plain_background(written.survey()) == ""

    def framed(pixels, value=255):
        pixels = pixels.copy()
        pixels[:10] = pixels[:, :10] = pixels[:, -10:] = value
        return pixels

    written.change(range(24), framed)
    assert plain_background(written.survey()) == "white"
    written.change(range(24), lambda pixels: framed(pixels, 0))
    assert plain_background(written.survey()) == "black"
