"""Names and values of result files as people read them."""

import pytest

from gsfw.reports.plain_text import growth, image_sizes


@pytest.mark.parametrize(
    ("sizes", "downscale", "words"),
    [
        ([[718, 1280]], 1.0, "718 x 1280 pixels"),
        ([[239, 427]], 3.0, "239 x 427 pixels (1/3 of their size)"),
        ([[239, 427], [427, 239]], 2.8, "239 x 427 or 427 x 239 pixels (1/2.8 of their size)"),
        ([[64, 48], [100, 20], [32, 24]], 1, "32 x 24 to 64 x 48 pixels"),
    ],
)
def test_sizes_of_compared_images_are_told_with_the_part_they_are(sizes, downscale, words):
    assert image_sizes({"image_sizes": sizes, "downscale": downscale}) == words


@pytest.mark.parametrize("damaged", [None, [], "32x24", [[1]], [7]])
def test_sizes_that_are_not_known_are_no_words(damaged):
    assert image_sizes({"image_sizes": damaged, "downscale": 2.0}) == ""


def test_a_strategy_named_error_does_not_read_like_a_failure():
    assert growth("error") == "growth by error"
    assert growth("none") == "no growth"
