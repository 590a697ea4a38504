"""Readings of two clocks, and their medians."""

from gsfw.commands.bench_timing import Timings, total
from gsfw.core.rasterizer import StageTime


def test_figures_are_medians_and_least_values_of_each_clock():
    timings = Timings()
    for cpu, wall in ((3.0, 9.0), (1.0, 4.0), (2.0, 5.0)):
        timings.add("blend", StageTime(cpu, wall))
    assert timings.figures() == {
        "blend_ms": 2.0,
        "blend_wall_ms": 5.0,
        "blend_min_ms": 1.0,
        "blend_min_wall_ms": 4.0,
    }


def test_a_stage_is_measured_by_both_clocks():
    timings = Timings()
    with timings.stage("counting"):
        sum(range(1000))
    reading = timings.latest("counting")
    assert reading.cpu_ms >= 0.0
    assert reading.wall_ms > 0.0


def test_stages_add_up():
    assert total([StageTime(1.0, 2.0), StageTime(3.0, 5.0)]) == StageTime(4.0, 7.0)
