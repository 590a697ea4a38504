"""How many updates a time allows."""

import pytest

from gsfw.planning.speed import Speed

SPEED = Speed(
    downscale=2.0, pixels=60_000, gaussians=10_000, state_bytes=7e6, before=10.0, step=0.05,
    view=0.02, load=0.03, views=50, held_out=7,
)  # fmt: skip


def test_updates_and_seconds_are_inverse():
    for divisor in (1.0, 2.0, 4.0):
        updates = SPEED.updates(300.0, divisor)
        assert SPEED.seconds(updates, divisor) == pytest.approx(300.0)


def test_smaller_images_leave_more_updates():
    counts = [SPEED.updates(120.0, divisor) for divisor in (1.0, 2.0, 4.0)]
    assert counts == sorted(counts)
    assert SPEED.view_pixels(1.0) == 240_000


def test_a_time_shorter_than_what_is_around_training_leaves_no_updates():
    assert SPEED.updates(SPEED.around(2.0), 2.0) == pytest.approx(0.0)
    assert SPEED.updates(1.0, 2.0) < 0
