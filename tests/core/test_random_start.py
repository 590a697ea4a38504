"""The number of random Gaussians follows the size of the views."""

import pytest

from gsfw.core.random_start import random_count


@pytest.mark.parametrize(
    ("side", "count"),
    [(100, 5_000), (200, 10_000), (400, 40_000), (800, 100_000), (4000, 100_000)],
)
def test_a_random_start_has_a_quarter_of_a_views_pixels_within_bounds(side, count):
    assert random_count(side * side) == count


def test_thumbnails_start_from_half_of_their_pixels():
    assert random_count(64 * 48) == 1536
    assert random_count(1) == 1


def test_views_of_unknown_size_start_from_the_papers_number():
    assert random_count(0) == 100_000
