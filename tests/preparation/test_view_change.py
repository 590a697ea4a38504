"""How far the view has moved."""

import numpy as np
import pytest
from PIL import Image
from support.panorama import WIDTH, view

from gsfw.preparation.view_change import KNOWN, NO_OVERLAP, ViewPath, is_plain, overlap


def small(grey):
    """As the view is followed on: 160 pixels wide."""
    image = Image.fromarray(grey.astype(np.float32)).resize((160, 120), Image.Resampling.BOX)
    return np.asarray(image, np.float32)


def noisy(grey, number, size=3.0):
    return grey + np.random.default_rng(number).normal(0, size, grey.shape)


def followed(views):
    path = ViewPath()
    for grey in views:
        path.add(small(grey))
    return path


@pytest.mark.parametrize("shift", [(3, 0), (-7, 5), (12, 8), (40, -20), (110, 30)])
def test_shifts_are_found_to_a_fraction_of_a_pixel(shift):
    found = overlap(small(view(200, 150)), small(view(200 + shift[0], 150 + shift[1])))
    assert found.seen > 0.9
    assert found.shift == pytest.approx(np.hypot(*shift) / WIDTH, abs=0.002)


def test_exposure_is_no_movement():
    seen = overlap(small(view(200)), small(noisy(0.5 * view(206) + 10, 0)))
    assert seen.shift == pytest.approx(6 / WIDTH, abs=0.002)
    assert overlap(small(view(200)), small(0.5 * view(200) + 10)).shift == 0


def test_unrelated_images_have_nothing_in_common():
    for number in range(5):
        found = overlap(small(view(100 * number)), small(view(100 * number, seed=1)))
        assert found.seen < KNOWN / 2
        assert not found.found


def test_a_camera_that_stands_still_goes_nowhere():
    path = followed([noisy(view(200), number) for number in range(40)])
    assert path.positions == [0.0] * 40
    assert not path.jumps
    assert not any(path.strange)


def test_trembling_arrives_nowhere():
    offsets = 4 * np.sin(1.3 * np.arange(60)), 3 * np.cos(0.9 * np.arange(60))
    path = followed([view(200 + x, 100 + y) for x, y in zip(*offsets, strict=True)])
    assert path.positions[-1] < 0.03


def test_somebody_who_walks_before_a_camera_is_no_movement_of_it():
    views = []
    for number in range(20):
        grey = view(200).copy()
        grey[60:, 10 * number : 10 * number + 90] = view(900)[60:, :90]
        views.append(grey)
    assert followed(views).positions[-1] < 0.002


@pytest.mark.parametrize("step", [5, 20, 100])
def test_a_pan_comes_as_far_as_it_goes_whatever_its_speed(step):
    path = followed([view(x) for x in range(0, 601, step)])
    assert path.positions[-1] == pytest.approx(600 / WIDTH, rel=0.1)
    assert path.positions == sorted(path.positions)
    assert not path.jumps


def test_there_and_back_is_twice_the_way():
    there = [view(x) for x in range(0, 400, 8)]
    assert followed(there + there[::-1]).positions[-1] == pytest.approx(800 / WIDTH, rel=0.1)


def test_a_cut_is_a_jump():
    path = followed([view(5 * i) for i in range(10)] + [view(5 * i, seed=1) for i in range(10)])
    assert path.jumps == [10]
    assert path.positions[10] - path.positions[9] == NO_OVERLAP
    assert not any(path.strange)


def test_flashes_and_plain_images_are_strange_and_change_nothing_else():
    views = [view(4 * number) for number in range(40)]
    plain = followed(views).positions
    views[10] = np.full_like(views[0], 255.0)
    views[20], views[21] = view(100, seed=1), view(100, seed=2)
    path = followed(views)
    assert np.flatnonzero(path.strange).tolist() == [10, 20, 21]
    assert path.jumps == []
    assert path.positions[-1] == pytest.approx(plain[-1], abs=0.005)
    assert path.positions == sorted(path.positions)


def test_a_long_look_elsewhere_is_a_scene_of_its_own():
    path = followed([view(0)] * 4 + [view(0, seed=1)] * 6 + [view(0)] * 4)
    assert path.jumps == [4, 10]
    assert not any(path.strange)


@pytest.mark.slow
def test_images_that_never_match_are_all_jumps():
    path = followed([view(100, seed=seed) for seed in range(8)])
    assert path.jumps == list(range(1, 8))
    assert not any(path.strange)


def test_plain_images_are_told():
    assert is_plain(np.full((90, 160), 77, np.float32))
    assert not is_plain(small(view(0)))


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (5, 3), (20, 160)])
def test_tiny_images_are_compared_as_well_as_may_be(shape):
    generator = np.random.default_rng(0)
    path = ViewPath()
    for _ in range(3):
        path.add(generator.uniform(0, 255, shape).astype(np.float32))
    assert len(path.positions) == 3
