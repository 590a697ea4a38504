from itertools import product

import numpy as np
import pytest
from scipy import ndimage
from support.captured import arc, photos
from support.sampling import sampled

from gsfw.preparation.blur import BLOCK, DIRECTED, direction_of_blur


@pytest.fixture(scope="module")
def grey() -> np.ndarray:
    return photos(arc(1))[0].mean(2) / 255


def moved(grey: np.ndarray, pixels: float, degrees: float) -> np.ndarray:
    """The image as a camera sees it that moves while its shutter is open."""
    steps = np.linspace(-pixels / 2, pixels / 2, 41)
    across, down = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    shifted = [ndimage.shift(grey, (s * down, s * across), order=1, mode="nearest") for s in steps]
    return np.round(np.mean(shifted, 0) * 255) / 255


@pytest.mark.parametrize(
    ("pixels", "degrees"),
    sampled(list(product([6.0, 12.0], [0.0, 30.0, 90.0, 135.0])), daily=(1, 6)),
)
def test_motion_blur_has_the_direction_of_the_motion(grey, pixels, degrees):
    direction, ratio = direction_of_blur(moved(grey, pixels, degrees))
    assert ratio < DIRECTED
    assert abs((direction - degrees + 90) % 180 - 90) < 12


def test_a_motion_of_three_pixels_takes_half_of_what_tells_directions_apart(grey):
    assert direction_of_blur(moved(grey, 3, 30))[1] < 0.6 * direction_of_blur(grey)[1]


@pytest.mark.parametrize("sigma", [0.0, 1.0, 2.0])
def test_sharp_images_and_round_blur_have_no_direction(grey, sigma):
    assert direction_of_blur(ndimage.gaussian_filter(grey, sigma))[1] > 1.5 * DIRECTED


def test_vertical_lines_are_not_blurred():
    lines = 0.1 + 0.8 * (np.sin(0.7 * np.arange(320)) > 0)
    assert direction_of_blur(np.tile(lines, (240, 1)))[1] > DIRECTED


def test_images_without_detail_or_smaller_than_a_block_have_no_direction():
    assert direction_of_blur(np.full((240, 320), 0.4)) == (0.0, 1.0)
    assert direction_of_blur(np.random.default_rng(0).random((BLOCK - 1, 200))) == (0.0, 1.0)
