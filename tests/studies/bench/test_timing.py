"""Readings of two clocks, and their medians."""

import pytest
import torch

from gsfw.core.rasterizer import StageTime
from gsfw.studies.bench import timing
from gsfw.studies.bench.timing import Timings, begin_peak, peak_mb, timings_on, total, warm_up


def test_figures_are_medians_and_least_values_of_each_clock():
    timings = Timings()
    for cpu, wall in ((3.0, 9.0), (1.0, 4.0), (2.0, 5.0)):
        timings.add("blend", StageTime(cpu, wall))
    assert timings.figures() == {
        "blend_ms": 2.0,
        "blend_wall_ms": 5.0,
        "blend_min_ms": 1.0,
        "blend_min_wall_ms": 4.0,
        "blend_spread_ms": 5.0,
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


class Gpu:
    """A GPU whose clock goes on by 1 ms with every mark, and that notes who waits for it."""

    def __init__(self, monkeypatch):
        self.log: list[str] = []
        self.now = 0.0
        monkeypatch.setattr(timing, "mark", self.mark)
        monkeypatch.setattr(timing, "milliseconds", lambda begin, end: end - begin)
        monkeypatch.setattr(timing, "wait_for", lambda device: self.log.append("wait"))

    def mark(self, device: torch.device):
        self.now += 1.0
        self.log.append("mark")
        return self.now


def test_on_a_gpu_the_host_waits_around_the_outermost_stage_only(monkeypatch):
    gpu = Gpu(monkeypatch)
    timings = timings_on(torch.device("cuda"))
    with timings.stage("step"):
        with timings.stage("render"):
            pass
        with timings.stage("loss"):
            pass
    assert gpu.log == ["wait", *["mark"] * 6, "wait"]
    assert timings.latest("render") == StageTime(1.0, 1.0)
    assert timings.latest("step").cpu_ms == 5.0
    assert timings.latest("step").wall_ms < 1000.0
    with timings.stage("step"):
        pass
    figures = timings.figures()
    assert (figures["step_ms"], figures["step_min_ms"], figures["loss_ms"]) == (3.0, 1.0, 1.0)


def test_a_stage_that_fails_on_a_gpu_leaves_the_clock_usable(monkeypatch):
    Gpu(monkeypatch)
    timings = timings_on(torch.device("cuda"))
    with pytest.raises(ValueError, match="broken"), timings.stage("render"):
        raise ValueError("broken")
    with timings.stage("render"):
        pass
    assert timings.latest("render").cpu_ms == 1.0


def test_the_cpu_has_no_peak_and_is_warm():
    cpu = torch.device("cpu")
    assert begin_peak(cpu) == peak_mb(cpu) == 0.0
    warm_up(cpu)
