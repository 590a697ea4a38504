"""Images on a device: which stay, what is sent when, and that nobody uses what is on its way."""

import threading
from concurrent.futures import Future

import numpy as np
import pytest
import torch
from support.slow_ship import SlowShip

from gsfw.core.errors import DataError
from gsfw.datamanagers.device_images import MOST_PASSING, DeviceImages, staying
from gsfw.datamanagers.image_cache import ImageCache
from gsfw.datamanagers.images import DecodedImage


def image(number: int) -> DecodedImage:
    return DecodedImage(np.full((4, 5, 3), 10 + number, np.uint8), np.full((4, 5), number % 2 == 0))


class Shelf:
    """Eight images on a stand-in of a device."""

    def __init__(self, kept=(), host_budget=10_000, decode=image) -> None:
        self.ship = SlowShip()
        self.cache = ImageCache(decode, [80] * 8, host_budget)
        self.images = DeviceImages(self.cache.request, self.ship, frozenset(kept))

    def shows(self, number: int) -> bool:
        found = self.images.get(number)
        return torch.equal(found.pixels, torch.from_numpy(image(number).pixels)) and bool(
            (found.mask == (number % 2 == 0)).all()
        )

    def ahead(self, *numbers: int) -> None:
        wanted = self.cache.prefetch(self.images.lacking(numbers))
        for number, future in wanted.items():
            self.images.send(number, future)

    def close(self) -> None:
        self.cache.close()
        self.images.close()


@pytest.fixture
def shelf():
    built = []

    def build(*args, **kwargs) -> Shelf:
        built.append(Shelf(*args, **kwargs))
        return built[-1]

    yield build
    for item in built:
        item.close()


def test_those_that_stay_are_the_first_that_fit():
    assert staying([10, 10, 10], 30) == {0, 1, 2}
    assert staying([10, 10, 10], 29) == {0, 1}
    assert staying([10, 25, 10, 5], 25) == {0, 2, 3}
    assert staying([10], 0) == staying([], 5) == frozenset()


def test_what_stays_is_sent_once_and_the_rest_at_each_use(shelf):
    three = shelf(kept=(0, 1))
    for _ in range(3):
        assert all(three.shows(number) for number in (0, 1, 2))
    assert sorted(three.ship.sent) == [10, 11, 12, 12, 12]


def test_what_is_sent_ahead_is_not_sent_again(shelf):
    one = shelf(kept=(0,))
    one.ahead(0, 1)
    one.ahead(0, 1, 2)
    assert all(one.shows(number) for number in (0, 1, 2))
    assert sorted(one.ship.sent) == [10, 11, 12]
    assert one.images.lacking([0, 1, 2]) == [1, 2]


def test_images_are_right_however_little_the_host_may_hold(shelf):
    # Decoding that was asked for ahead is cancelled where later requests need its room.
    for budget in (0, 80, 170, 400):
        tight = shelf(kept=(3,), host_budget=budget)
        for start in range(6):
            tight.ahead(start, start + 1, start + 2)
            for number in (start, 7 - start):
                assert tight.shows(number)


def test_a_cancelled_decoding_is_asked_for_again(shelf):
    one = shelf()
    cancelled: Future[DecodedImage] = Future()
    cancelled.cancel()
    cancelled.set_running_or_notify_cancel()
    one.images.send(5, cancelled)
    assert one.shows(5)


def test_wrong_guesses_of_what_comes_do_not_pile_up(shelf):
    one = shelf(kept=(0,))
    assert one.shows(0)
    ready: Future[DecodedImage] = Future()
    ready.set_result(image(1))
    for number in range(100, 150):
        one.images.send(number, ready)
    waiting = [number for number in range(100, 150) if not one.images.lacking([number])]
    assert waiting == list(range(150 - MOST_PASSING, 150))
    assert one.images.lacking([0]) == []


def test_an_error_of_decoding_reaches_whoever_asks(shelf):
    def fail(number: int) -> DecodedImage:
        raise DataError("broken.png: the file is empty (0 bytes).")

    one = shelf(kept=(0,), decode=fail)
    one.ahead(0)
    for _ in range(2):
        with pytest.raises(DataError, match=r"broken\.png"):
            one.images.get(0)


def test_the_thread_ends_with_the_images():
    before = set(threading.enumerate())
    shelf = Shelf()
    assert shelf.shows(1)
    assert set(threading.enumerate()) - before
    shelf.close()
    assert set(threading.enumerate()) <= before
