"""A run ends in its time on every machine: slow, growing, pausing, suddenly busy or idle."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gsfw.core.callback import RunInfo
from gsfw.core.loop.machine_clock import MachineClock, Work
from gsfw.core.loop.pace import Pace
from gsfw.core.loop.remaining_time import RemainingTime
from gsfw.core.loop.timekeeper import LARGEST_CHANGE, TRUST, Ending, Standing, Timekeeper

# Functions of numbers alone; the checks of shapes draw random numbers, which hypothesis refuses.
pytestmark = pytest.mark.unchecked

LIMIT = 60.0
GROWING = {
    "strategy.refine_every": 50, "strategy.refine_start": 100, "strategy.refine_stop": 1000,
}  # fmt: skip


class FakeClock(MachineClock):
    """A clock that goes on when it is told to."""

    def __init__(self) -> None:
        super().__init__(0.0)
        self.now = self.ran = 0.0

    def seconds(self) -> float:
        return self.now

    def work(self) -> Work:
        return Work(self.ran, self.now - self.ran, 2 * self.now)

    def go_on(self, seconds: float, share: float = 1.0) -> None:
        """Pass time, of which the process gets a share of a processor."""
        self.now += seconds
        self.ran += share * seconds


@dataclass
class Walk:
    """How a run went."""

    seconds: float
    pace: Pace
    updates: int
    spans: list[int]


def walk(
    update_seconds: Callable[[float, int], float], steps: int = 2000, limit: float = LIMIT,
    ending: float = 0.0, gaussians: Callable[[int], int] = lambda step: 10_000,
    run_settings: dict | None = None, planned: Pace | None = None,
) -> Walk:  # fmt: skip
    """Walk through a schedule on a machine that takes some time for the update at a moment."""
    info = RunInfo(Path(), "3dgs", "toy", steps, 0, run_settings or {}, {})
    clock, pace = FakeClock(), planned or Pace()
    remaining = RemainingTime(info, recent=0.1)
    timekeeper = Timekeeper(remaining, limit, Ending(seconds=ending), clock)
    step = updates = 0
    spans = []
    timekeeper.restart(0, 0)
    while step < steps:
        assert clock.now < 100 * limit, "it never ends"
        clock.go_on(update_seconds(clock.now, gaussians(step)))
        spans.append(min(pace.span(updates), steps - step))
        standing = Standing(
            updates + 1, step + spans[-1], steps, gaussians(step), 1.0, pace.thousandths(updates),
            pace.planned,
        )  # fmt: skip
        updates, step = updates + 1, standing.step
        decision = timekeeper.decide(standing)
        if decision is not None:
            pace.decide(decision)
    return Walk(clock.now + ending, pace, updates, spans)


def test_a_plan_that_was_right_is_left_alone():
    found = walk(lambda now, rows: 0.03)
    assert found.pace.decisions == ()
    assert found.updates == 2000


@pytest.mark.slow
@settings(max_examples=25)
@example(before=0.125, after=0.006, change_at=0.75, ending=0.0, growth=1.0)
@given(
    before=st.floats(0.004, 0.2),
    after=st.floats(0.004, 0.2),
    change_at=st.floats(0.0, 0.9),
    ending=st.floats(0.0, 6.0),
    growth=st.floats(1.0, 10.0),
)
def test_a_run_ends_within_ten_percent_whatever_becomes_of_the_machine(
    before, after, change_at, ending, growth
):
    def gaussians(step: int) -> int:
        return int(10_000 * (1 + (growth - 1) * min(max(step - 100, 0), 900) / 900))

    def seconds(now: float, rows: int) -> float:
        return (before if now < change_at * LIMIT else after) * (rows / 10_000) ** 0.5

    found = walk(seconds, gaussians=gaussians, ending=ending, run_settings=GROWING)
    assert found.seconds == pytest.approx(LIMIT, rel=0.1)


@pytest.mark.slow
@settings(max_examples=30)
@given(pause_at=st.floats(0.05, 0.85), pause=st.floats(0.0, 8.0))
def test_a_pause_costs_steps_and_not_the_end(pause_at, pause):
    paused = []

    def seconds(now: float, rows: int) -> float:
        if now >= pause_at * LIMIT and not paused:
            paused.append(True)
            return 0.03 + pause
        return 0.03

    assert walk(seconds).seconds == pytest.approx(LIMIT, rel=0.1)


def test_a_run_whose_time_was_over_in_a_long_pause_ends_at_once_with_a_whole_schedule():
    asleep = iter([600.0])
    found = walk(lambda now, rows: next(asleep, 0.03) if now > 30 else 0.03)
    assert found.seconds < 631
    assert sum(found.spans) == 2000


def test_steps_of_uneven_time_do_not_make_a_restless_pace():
    found = walk(lambda now, rows: 0.02 if int(now * 1000) % 2 else 0.04)
    assert found.seconds == pytest.approx(LIMIT, rel=0.1)
    assert all(abs(item.thousandths - 1000) < 400 for item in found.pace.decisions)


def test_fixed_work_at_the_end_takes_longer_on_a_busy_machine():
    clock = FakeClock()
    info = RunInfo(Path(), "3dgs", "toy", 1000, 0, {}, {})
    timekeeper = Timekeeper(RemainingTime(info), 100.0, Ending(seconds=2.0), clock)
    timekeeper.restart(0, 0)
    standing = Standing(50, 50, 1000, 100, 1.0, 1000)
    assert timekeeper.reserved(standing) == pytest.approx(2.0)
    clock.go_on(5.0, share=0.5)
    timekeeper.decide(standing)
    assert timekeeper.reserved(standing) == pytest.approx(4.0)


def test_time_that_a_run_took_before_it_was_resumed_counts():
    clock = FakeClock()
    info = RunInfo(Path(), "3dgs", "toy", 1000, 1, {}, {})
    timekeeper = Timekeeper(RemainingTime(info), 60.0, Ending(), clock, spent=40.0)
    timekeeper.restart(1, 1)
    clock.go_on(3.0)
    assert timekeeper.spent() == 43.0
    decision = timekeeper.decide(Standing(100, 100, 1000, 100, 1.0, 1000))
    assert decision.thousandths == pytest.approx(1000 * LARGEST_CHANGE), "17 s for 27 s of work"


def test_a_run_that_goes_on_measures_before_it_changes_its_pace_by_much():
    clock = FakeClock()
    info = RunInfo(Path(), "3dgs", "toy", 1000, 600, {}, {})
    timekeeper = Timekeeper(RemainingTime(info), 60.0, Ending(), clock, spent=40.0)
    timekeeper.restart(600, 600)
    clock.go_on(0.3)
    assert timekeeper.decide(Standing(601, 601, 1000, 100, 1.0, 1000)) is None
    clock.go_on(5.0)  # Images are decoded, or the machine is busy for a moment.
    decision = timekeeper.decide(Standing(640, 640, 1000, 100, 1.0, 1000))
    assert decision.thousandths == 1000 * LARGEST_CHANGE


def test_the_time_of_the_last_evaluation_is_kept_for_a_run_that_goes_on():
    info = RunInfo(Path(), "3dgs", "toy", 1000, 0, {}, {"views": 20})
    timekeeper = Timekeeper(RemainingTime(info), 60.0, Ending(), FakeClock())
    timekeeper.restart(0, 0)
    with timekeeper.apart():
        timekeeper._clock.go_on(10.0)
    timekeeper.evaluated(500, 20)
    assert timekeeper.view_seconds == pytest.approx(0.5)
    again = RemainingTime(info)
    again.evaluated(500, timekeeper.view_seconds, 1)
    assert again.evaluation_seconds() == pytest.approx(10.0)


def test_evaluations_are_no_part_of_the_speed_of_steps():
    clock = FakeClock()
    info = RunInfo(Path(), "3dgs", "toy", 1000, 0, {}, {})
    timekeeper = Timekeeper(RemainingTime(info), 60.0, Ending(), clock)
    timekeeper.restart(0, 0)
    with timekeeper.apart():
        clock.go_on(20.0)
    clock.go_on(3.0)
    decision = timekeeper.decide(Standing(100, 100, 1000, 100, 1.0, 1000))
    assert decision.thousandths == pytest.approx(1000 * 900 * 0.03 / 37, rel=0.05)


def test_early_guesses_of_later_costs_hurry_no_run():
    # Twice as long as expected, and twenty times as long in a moment of the first tenth.
    found = walk(lambda now, rows: 0.6 if 5 < now < 6 else 0.06)
    early = [item for item in found.pace.decisions if item.update < 0.2 * found.updates]
    assert early
    assert max(item.thousandths for item in early) <= 1000 * (1 + TRUST * 0.25)
    assert found.seconds == pytest.approx(LIMIT, rel=0.1)


@pytest.mark.parametrize("speed", [0.8, 1.0, 1.25])
def test_a_schedule_longer_than_its_updates_is_half_done_at_half_time(speed):
    planned = Pace.parse(["0:8.000"])
    found = walk(lambda now, rows: 0.05 / speed, steps=8 * 1200, planned=planned)
    half = found.pace.step(round(0.5 * found.updates)) / (8 * 1200)
    assert half == pytest.approx(0.5, abs=0.1)
    assert not any(found.pace.hastens(updates) for updates in range(found.updates))
    assert found.seconds == pytest.approx(LIMIT, rel=0.1)
