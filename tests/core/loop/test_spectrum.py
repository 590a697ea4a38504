"""How much detail smaller copies keep."""

import numpy as np
import pytest

from gsfw.core.loop.spectrum import MAX_SIDE, detail_kept

FACTORS = (1.5, 2.0, 4.0, 8.0)


def noise(height: int, width: int) -> np.ndarray:
    return np.random.default_rng(0).random((height, width))


def waves(period: float, side: int = 256) -> np.ndarray:
    """Stripes of so many pixels."""
    return np.tile(np.sin(2 * np.pi * np.arange(side) / period), (side, 1))


def test_noise_keeps_the_share_of_frequencies_that_are_left():
    kept = detail_kept(noise(300, 400), FACTORS)
    assert kept == pytest.approx([1 / factor**2 for factor in FACTORS], abs=0.02)


def test_stripes_survive_until_a_pixel_is_half_as_wide_as_they_are():
    kept = detail_kept(waves(period=10), FACTORS)
    assert kept[2] > 0.99, "stripes of 10 pixels fit at a quarter: 2.5 of those pixels"
    assert kept[3] < 0.05, "and not at an eighth"


def test_a_picture_without_detail_loses_none():
    assert np.array_equal(detail_kept(np.full((70, 90), 0.3), FACTORS), np.ones(4))


def test_brightness_does_not_count_and_contrast_does_not_matter():
    picture = noise(80, 70)
    assert detail_kept(5 + 0.1 * picture, FACTORS) == pytest.approx(detail_kept(picture, FACTORS))


def test_large_pictures_are_judged_by_their_middle():
    picture = np.zeros((MAX_SIDE + 200, 90))
    picture[:100] = noise(100, 90)
    assert np.array_equal(detail_kept(picture, FACTORS), np.ones(4))


@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (2, 3)])
def test_tiny_pictures_have_an_answer(shape):
    kept = detail_kept(noise(*shape), FACTORS)
    assert np.isfinite(kept).all()
