"""Views of panoramas: every pixel shows what a pinhole camera of that direction sees."""

import numpy as np
import pytest
from support.panorama_room import colors, panorama

from gsfw.datamanagers.warp import MapCache
from gsfw.preparation.panorama_views import AROUND, DIRECTIONS, continued, cut, map_bytes, view_side

WIDTH = 512
CENTER = np.array([0.3, -0.2, 0.4])


@pytest.fixture(scope="module")
def whole() -> np.ndarray:
    return continued(panorama(CENTER, np.eye(3), WIDTH))


def true_view(direction, side: int) -> np.ndarray:
    """The same view of the room by a pinhole camera, with four rays for each pixel."""
    steps = (np.arange(2 * side) + 0.5) / side - 1
    x, y = np.meshgrid(steps, steps)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ direction.from_panorama
    return colors(CENTER, rays).reshape(side, 2, side, 2, 3).mean(axis=(1, 3))


@pytest.mark.parametrize("direction", DIRECTIONS, ids=lambda one: one.name)
def test_a_view_is_that_of_a_pinhole_camera(whole, direction):
    pixels = cut(whole, direction, MapCache())
    side = view_side(WIDTH)
    assert pixels.shape == (side, side, 3)
    truth = true_view(direction, side)

    def error(moved: np.ndarray) -> float:
        return float(np.abs(moved[2:-2, 2:-2] - truth[2:-2, 2:-2]).mean())

    # Textures finer than pixels differ, but no shift by a part of a pixel fits better.
    here = error(pixels.astype(float))
    assert here < 12
    for axis in (0, 1):
        for step in (-1, 1):
            aside = 0.75 * pixels + 0.25 * np.roll(pixels, step, axis)
            assert here < error(aside)


def test_views_around_see_the_whole_horizon_with_overlap():
    ahead = np.array([one.from_panorama[2] for one in DIRECTIONS[:AROUND]])
    assert np.allclose(ahead[:, 1], 0)
    turns = np.degrees(np.arctan2(ahead[:, 0], ahead[:, 2])) % 360
    assert np.allclose(turns, range(0, 360, 60))


def test_the_poles_are_up_and_down():
    up, down = (one.from_panorama[2] for one in DIRECTIONS[AROUND:])
    assert np.allclose(up, [0, -1, 0])
    assert np.allclose(down, [0, 1, 0])


def test_the_middle_of_a_view_has_the_resolution_of_the_panorama():
    assert view_side(7680) == 2444
    # A pixel in the middle is seen under the angle 1 / focal length.
    assert abs(2 / view_side(7680) - 2 * np.pi / 7680) < 1e-6
    assert map_bytes(7680, 6) < 300e6
