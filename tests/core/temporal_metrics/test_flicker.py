"""Flicker is change that the true pictures do not have."""

import pytest
import torch

from gsfw.core.temporal_metrics.flicker import Flicker, Still

LEFT = torch.tensor([[True], [False]])[None]
"""Of a picture of two pixels, the left one moves."""


def picture(left: float, right: float) -> torch.Tensor:
    return torch.tensor([[[left] * 3, [right] * 3]])


def still(time, rendered, target, camera="a", valid=None) -> Still:
    return Still(camera, time, picture(*rendered), picture(*target), LEFT, valid)


def figures(*stills):
    flicker = Flicker()
    for item in stills:
        flicker.add(item)
    return dict(flicker.figures()), flicker.note()


def test_static_and_moving_pixels_are_told_apart():
    found, note = figures(
        still(0.0, (0.2, 0.5), (0.1, 0.5)),
        still(0.5, (0.5, 0.6), (0.2, 0.5)),
        still(1.0, (0.6, 0.5), (0.3, 0.5)),
    )
    # Left: 0.3 and 0.1 drawn, 0.1 and 0.1 true. Right: 0.1 and -0.1 drawn, 0 and 0 true.
    assert found["flicker_moving"] == pytest.approx((0.2 + 0.0) / 2)
    assert found["flicker_static"] == pytest.approx(0.1)
    assert note == "2 pairs of neighbouring times, 0.5 apart on average"


def test_what_is_wrong_in_the_same_way_at_all_times_does_not_flicker():
    found, _ = figures(still(0.0, (0.9, 0.1), (0.2, 0.6)), still(1.0, (0.8, 0.1), (0.1, 0.6)))
    assert found == {"flicker_static": 0.0, "flicker_moving": pytest.approx(0.0, abs=1e-6)}


def test_pictures_of_different_cameras_or_of_one_time_make_no_pair():
    found, note = figures(
        still(0.0, (0.2, 0.5), (0.1, 0.5)),
        still(0.0, (0.9, 0.9), (0.1, 0.5)),
        still(0.5, (0.5, 0.6), (0.2, 0.5), camera="b"),
    )
    assert found == {}
    assert note == "not available: no held-out camera shows several times"


def test_pixels_that_are_not_valid_in_either_picture_do_not_count():
    right = ~LEFT
    found, _ = figures(
        still(0.0, (0.2, 0.5), (0.1, 0.5)), still(1.0, (0.9, 0.7), (0.1, 0.5), valid=right)
    )
    assert found == {"flicker_static": pytest.approx(0.2)}


def test_values_beyond_white_count_as_white():
    found, _ = figures(still(0.0, (1.0, 1.0), (1.0, 1.0)), still(1.0, (5.0, 1.5), (1.0, 1.0)))
    assert found == {"flicker_static": 0.0, "flicker_moving": 0.0}
