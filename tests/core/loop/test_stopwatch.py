"""The stopwatch of steps."""

import time

from gsfw.core.loop.stopwatch import Stopwatch


def test_what_is_paused_is_no_part_of_a_step():
    clock = Stopwatch()
    with clock.paused():
        time.sleep(0.2)
    clock.step_done()
    total, _ = clock.read()
    assert total < 150
