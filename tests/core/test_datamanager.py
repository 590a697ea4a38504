"""Tests of gsfw.core.datamanager."""

from gsfw.core.datamanager import spread


def test_a_sample_is_spread_from_the_first_to_the_last():
    assert spread(range(100), 4) == [0, 33, 66, 99]
    assert spread(range(100), 1) == [0]
    assert [*spread(range(3), 4)] == [*spread(range(3), 0)] == [0, 1, 2]
