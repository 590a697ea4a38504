"""The machine clock tells other work from threads that have nothing to do."""

import time
from collections.abc import Callable

import pytest

from gsfw.core.loop import machine_clock
from gsfw.core.loop.machine_clock import MachineClock, Work


@pytest.fixture
def made_threads(tmp_path, monkeypatch) -> Callable[..., None]:
    """Makes threads that ran and waited for so many seconds: files as Linux has them."""
    monkeypatch.setattr(machine_clock, "THREADS", tmp_path)
    monkeypatch.setattr(time, "process_time", lambda: 0.0)

    def made(*times: tuple[float, float], ended: float = 0.0) -> None:
        for number, (ran, waited) in enumerate(times):
            thread = tmp_path / str(number)
            thread.mkdir(exist_ok=True)
            thread.joinpath("schedstat").write_text(f"{int(ran * 1e9)} {int(waited * 1e9)} 12\n")
        total = ended + sum(ran for ran, _ in times)
        monkeypatch.setattr(time, "process_time", lambda: total)

    return made


@pytest.fixture
def clock(made_threads, monkeypatch) -> MachineClock:
    """A clock of a process on two cores, from 0 to 4 seconds."""
    monkeypatch.setattr(machine_clock, "cores", lambda: 2)
    made, now = MachineClock(time.perf_counter()), iter([0.0, 4.0])
    monkeypatch.setattr(made, "seconds", lambda: next(now))
    return made


def test_threads_that_wait_for_processors_slow_a_run_down(clock, made_threads):
    made_threads((5.0, 1.0), (2.0, 0.0))
    before = clock.work()
    made_threads((7.0, 3.0), (2.0, 0.0))
    assert clock.work().slowdown(before) == pytest.approx(2.0)


def test_threads_that_wait_for_one_another_are_no_sign_of_other_work(clock, made_threads):
    before = clock.work()
    made_threads(*[(4 / 3, 8 / 3)] * 6)  # Six threads on two cores, for 4 s.
    assert clock.work().slowdown(before) == pytest.approx(1.0)


def test_many_threads_beside_other_work_are_slowed_down_by_that_alone(clock, made_threads):
    before = clock.work()
    made_threads(*[(1.0, 3.0)] * 6)  # Two other threads have a quarter of both cores.
    assert clock.work().slowdown(before) == pytest.approx(4 / 3)


def test_processors_without_work_are_no_sign_of_other_work(made_threads):
    clock = MachineClock(time.perf_counter())
    idle = [(0.0, 0.0)] * 63
    made_threads((1.0, 0.0), *idle)
    before = clock.work()
    made_threads((11.0, 0.0), *idle)
    assert clock.work().slowdown(before) == 1.0


def test_a_system_that_does_not_tell_has_no_other_work(tmp_path, monkeypatch):
    monkeypatch.setattr(machine_clock, "THREADS", tmp_path / "missing")
    clock = MachineClock(time.perf_counter())
    assert clock.work().waited == 0
    assert clock.work().slowdown(Work()) == 1.0


def test_the_work_of_threads_that_have_ended_counts(clock, made_threads):
    made_threads((4.0, 0.0), (3.0, 0.0))
    before = clock.work()
    made_threads((0.01, 0.0), (3.0, 1.0), ended=5.99)  # The first has ended, another begun.
    assert clock.work().slowdown(before) == pytest.approx(1.5)


def test_waits_of_threads_that_have_ended_are_no_speed_up():
    assert Work(ran=8.0, waited=1.0).slowdown(Work(ran=6.0, waited=5.0)) == 1.0
