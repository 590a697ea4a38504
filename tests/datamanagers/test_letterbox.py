"""Lenses of videos that were scaled, or fitted between black bars."""

from dataclasses import replace

import numpy as np
import pytest
from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH
from support.small_videos import image, write_video

from gsfw.core.errors import DataError
from gsfw.datamanagers.camera_sequence import fit_to_video
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.video import Video

pytest.importorskip("av", reason="PyAV, which decodes videos, is not installed")

LENS = Lens(*FOCAL, *CENTER, WIDTH, HEIGHT, "camera 1 of cameras.json")


def video(path, width, height, box=None):
    """A video of this size; with ``box`` it is black outside of that."""

    def draw(number, *_):
        if box is None:
            return image(number, width, height)
        left, top, right, bottom = box
        pixels = np.zeros((height, width, 3), np.uint8)
        pixels[top:bottom, left:right] = image(number, right - left, bottom - top)
        return pixels

    return Video.read(write_video(path / "a.mp4", 3, width, height, draw=draw))


def test_a_video_of_the_right_size_stays_as_it_is(tmp_path):
    made = video(tmp_path, WIDTH, HEIGHT)
    assert fit_to_video(LENS, made) == (LENS, made, "")


def test_a_scaled_video_scales_the_lens(tmp_path):
    lens, fitted, note = fit_to_video(LENS, video(tmp_path, 96, 72))
    assert (lens.fx, lens.cx, lens.width) == (1.5 * FOCAL[0], 1.5 * CENTER[0], 96)
    assert fitted.box is None
    assert note == "a.mp4 is 96x72, 64x48 scaled"


@pytest.mark.parametrize(
    ("size", "box"), [((56, 48), (0, 3, 56, 45)), ((100, 48), (18, 0, 82, 48))]
)
def test_black_bars_are_cut_off(tmp_path, size, box):
    lens, fitted, note = fit_to_video(LENS, video(tmp_path, *size, box))
    width, height = box[2] - box[0], box[3] - box[1]
    assert (fitted.header.width, fitted.header.height) == (width, height)
    assert lens == LENS.resized(width, height)
    assert float(fitted.image(1).min()) > 20
    assert note == (
        f"a.mp4 is {size[0]}x{size[1]}, 64x48 scaled to {width}x{height} between black bars, "
        "which are cut off"
    )


def test_another_shape_without_bars_is_refused(tmp_path):
    with pytest.raises(
        DataError,
        match=r"a\.mp4 is 56x48 pixels, but camera 1 of cameras\.json describes 64x48, which is "
        r"another shape, and there are no black bars\.",
    ):
        fit_to_video(LENS, video(tmp_path, 56, 48))


def test_a_turned_video_is_called_so(tmp_path):
    with pytest.raises(DataError, match=r"They differ by a quarter turn"):
        fit_to_video(LENS, video(tmp_path, HEIGHT, WIDTH))


def test_an_all_black_video_has_no_bars(tmp_path):
    with pytest.raises(DataError, match=r"another shape"):
        fit_to_video(LENS, video(tmp_path, 56, 48, (0, 0, 0, 0)))


def test_a_lens_so_wide_that_nothing_of_the_video_is_within_its_bars_is_refused(tmp_path):
    wide = replace(LENS, width=1_000_000, height=2)
    with pytest.raises(DataError, match="another shape"):
        fit_to_video(wide, video(tmp_path, 56, 48))
