"""The cache of decoded images."""

import threading

import numpy as np
import pytest

from gsfw.core.errors import DataError
from gsfw.datamanagers.image_cache import ImageCache
from gsfw.datamanagers.images import DecodedImage


class Decoder:
    """Images that show their own number; counts how often each was decoded."""

    def __init__(self) -> None:
        self.counts: dict[int, int] = {}
        self._lock = threading.Lock()

    def __call__(self, index: int) -> DecodedImage:
        with self._lock:
            self.counts[index] = self.counts.get(index, 0) + 1
        return DecodedImage(np.full((1, 10, 3), index, np.uint8))


@pytest.fixture
def decoder() -> Decoder:
    return Decoder()


def cache_of(decoder, images: int, budget: int) -> ImageCache:
    return ImageCache(decoder, [30] * images, budget)


def test_an_image_is_decoded_once_while_it_fits(decoder):
    cache = cache_of(decoder, 3, budget=90)
    for index in (0, 1, 2, 0, 1, 2):
        assert cache.get(index).pixels[0, 0, 0] == index
    cache.close()
    assert decoder.counts == {0: 1, 1: 1, 2: 1}


def test_the_image_that_was_not_used_for_longest_makes_room(decoder):
    cache = cache_of(decoder, 3, budget=60)
    for index in (0, 1, 0, 2, 0, 1):
        cache.get(index)
    cache.close()
    assert decoder.counts == {0: 1, 1: 2, 2: 1}


def test_images_larger_than_the_budget_can_still_be_used(decoder):
    cache = cache_of(decoder, 2, budget=0)
    assert [cache.get(index).pixels[0, 0, 0] for index in (0, 1, 0)] == [0, 1, 0]
    cache.close()


def test_looking_ahead_decodes_before_use_and_only_once(decoder):
    cache = cache_of(decoder, 4, budget=1000)
    cache.prefetch([0, 1, 2])
    cache.get(1)
    cache.close()
    assert decoder.counts.get(1) == 1


def test_looking_ahead_takes_no_more_than_half_of_the_budget(decoder):
    cache = cache_of(decoder, 4, budget=120)
    cache.prefetch([0, 1, 2, 3])
    for index in range(4):
        cache.get(index)
    cache.close()
    assert decoder.counts == {0: 1, 1: 1, 2: 1, 3: 1}
    tight = cache_of(decoder, 4, budget=40)
    tight.prefetch([0, 1, 2, 3])
    tight.close()
    assert decoder.counts == {0: 1, 1: 1, 2: 1, 3: 1}


def test_an_error_reaches_whoever_asks_for_the_image():
    def fail(index: int) -> DecodedImage:
        raise DataError("broken.png: the file is empty (0 bytes).")

    cache = ImageCache(fail, [30], 1000)
    cache.prefetch([0])
    with pytest.raises(DataError, match=r"broken\.png"):
        cache.get(0)
    cache.close()


def test_half_as_many_images_are_kept_and_the_last_used_stay(decoder):
    cache = cache_of(decoder, 4, 120)
    before = [cache.get(index) for index in range(4)]
    assert cache.halve() == 60
    assert cache.get(3) is before[3]
    assert cache.get(2) is before[2]
    assert cache.get(0) is not before[0]
    assert cache.halve() == 30
    cache.close()
