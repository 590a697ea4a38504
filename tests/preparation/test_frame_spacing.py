"""Which images along a path are taken."""

import numpy as np
import pytest

from gsfw.preparation.frame_spacing import LONGEST, NEAREST, spaced


def choose(positions, count, sharpness=None, usable=None, times=None):
    positions = np.asarray(positions, float)
    number = len(positions)
    return spaced(
        positions,
        np.arange(number) / 30 if times is None else np.asarray(times),
        np.ones(number) if sharpness is None else np.asarray(sharpness, float),
        np.ones(number, bool) if usable is None else np.asarray(usable),
        count,
    )


@pytest.mark.parametrize("count", [1, 2, 7, 50, 150])
def test_an_even_path_gives_as_many_as_are_asked_for_evenly(count):
    positions = np.linspace(0, 4, 1000)
    chosen = choose(positions, count)
    assert len(chosen) == pytest.approx(count, abs=0.03 * count)
    gaps = np.diff(positions[chosen])
    assert (gaps > 0.5 * 4 / count).all()
    assert (gaps < 1.5 * 4 / count).all()


def test_equal_changes_of_the_view_not_equal_times():
    slow, quick = np.linspace(0, 1, 500, endpoint=False), np.linspace(1, 2, 50)
    chosen = choose(np.concatenate([slow, quick]), 40)
    assert (chosen < 500).sum() == pytest.approx((chosen >= 500).sum(), abs=2)


def test_standing_still_gives_one():
    positions = np.concatenate([np.linspace(0, 1, 100), np.ones(300), np.linspace(1, 2, 100)])
    chosen = choose(positions, 60)
    assert len(chosen) >= 57
    assert ((chosen >= 99) & (chosen < 400)).sum() <= 1


def test_the_sharpest_of_each_window_is_taken():
    sharpness = np.where(np.arange(300) % 3 == 1, 1.0, 0.2)
    chosen = choose(np.linspace(0, 3, 300), 40, sharpness)
    assert (chosen % 3 == 1).all()


def test_slightly_sharper_is_no_reason_to_leave_the_middle():
    sharpness = np.where(np.arange(100) % 10 == 0, 1.03, 1.0)
    chosen = choose(np.linspace(0, 1, 100), 10, sharpness)
    assert (abs(np.diff(chosen) - 10) <= 2).all()


def test_none_is_nearer_than_the_least_change():
    positions = np.sort(np.random.default_rng(0).uniform(0, 0.3, 400))
    chosen = choose(positions, 400)
    assert 30 <= len(chosen) <= 60
    assert (np.diff(positions[chosen]) >= NEAREST).all()


def test_images_that_are_stored_twice_are_taken_once():
    chosen = choose(np.repeat(np.linspace(0, 2, 100), 2), 200)
    assert len(chosen) == 100
    assert len(set(chosen // 2)) == 100


def test_slow_parts_are_not_left_out():
    positions = np.concatenate([np.linspace(0, 0.1, 900), np.linspace(0.1, 3, 100)])
    chosen = choose(positions, 20)
    assert len(chosen) == pytest.approx(20, abs=1)
    assert np.diff(chosen).max() <= 2 * LONGEST * 1000 / 20
    assert (chosen < 900).sum() >= 4


def test_those_that_may_not_be_taken_are_not():
    usable = np.arange(200) % 2 == 0
    assert (choose(np.linspace(0, 2, 200), 50, usable=usable) % 2 == 0).all()


def test_a_single_image_is_taken():
    assert choose([0.0], 5).tolist() == [0]
    assert choose([0.0, 0.0, 0.0], 5, sharpness=[1, 3, 2]).tolist() == [1]
