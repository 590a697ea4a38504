"""The area filter."""

import tracemalloc

import numpy as np
import pytest

from gsfw.datamanagers.area import shrink, shrink_mask, shrink_values, to_pixels, to_values


def noise(height: int, width: int, channels: int) -> np.ndarray:
    generator = np.random.default_rng(3)
    return generator.integers(0, 256, (height, width, channels), dtype=np.uint8)


def area_mean(image: np.ndarray, width: int, height: int) -> np.ndarray:
    """The mean over each small pixel's rectangle, pixel by pixel."""
    rows, columns = image.shape[:2]
    result = np.zeros((height, width, image.shape[2]))
    for i in range(height):
        for j in range(width):
            top, bottom = i * rows / height, (i + 1) * rows / height
            left, right = j * columns / width, (j + 1) * columns / width
            for y in range(rows):
                for x in range(columns):
                    covered = max(0.0, min(y + 1, bottom) - max(y, top)) * max(
                        0.0, min(x + 1, right) - max(x, left)
                    )
                    result[i, j] += covered * image[y, x]
            result[i, j] /= (bottom - top) * (right - left)
    return result


def test_a_whole_factor_gives_the_mean_of_each_block():
    image = noise(6, 8, 3)
    wanted = image.reshape(3, 2, 4, 2, 3).astype(float).mean((1, 3))
    assert np.abs(shrink(image, 4, 3) - wanted).max() <= 0.5


def test_pixels_on_a_border_count_by_the_part_that_is_covered():
    image = noise(7, 10, 3)
    assert np.abs(shrink(image, 4, 3) - area_mean(image, 4, 3)).max() <= 0.5 + 1e-4


@pytest.mark.parametrize("size", [(411, 133), (1300, 50), (3, 7)])
@pytest.mark.parametrize("channels", [3, 4])
def test_strips_give_the_bits_of_the_whole_image(size, channels):
    image = noise(1300, 160, channels)
    whole = to_pixels(shrink_values(to_values(image), size[1], size[0]))
    assert np.array_equal(shrink(image, size[1], size[0]), whole)


def test_a_large_image_is_never_held_as_numbers():
    image = noise(3000, 400, 3)
    tracemalloc.start()
    try:
        shrink(image, 100, 750)
        assert tracemalloc.get_traced_memory()[1] < 3 * image.nbytes
    finally:
        tracemalloc.stop()


def test_the_same_size_changes_nothing():
    image = noise(5, 4, 3)
    assert shrink(image, 4, 5) is image


def test_what_cannot_be_seen_does_not_bleed_into_colours():
    image = np.zeros((2, 2, 4), np.uint8)
    image[0, 0] = (200, 100, 50, 255)
    image[1, 1] = (0, 255, 0, 0)
    assert shrink(image, 1, 1)[0, 0].tolist() == [200, 100, 50, 64]


def test_an_image_without_coverage_becomes_empty():
    assert shrink(np.zeros((4, 4, 4), np.uint8), 2, 2).max() == 0


def test_a_mask_is_valid_only_where_every_pixel_beneath_is():
    mask = np.ones((4, 6), bool)
    mask[0, 0] = False
    assert shrink_mask(mask, 3, 2).tolist() == [[False, True, True], [True, True, True]]
    assert shrink_mask(mask, 6, 4) is mask
